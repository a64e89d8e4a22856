"""Textures on feedback: a bounded cache of tiles without holes, stale tiles or any use that a plain model has not."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from test_tile_cache import Model
from texture_maps import (
    MAPS,
    make_samples_kernel,
    make_texels_kernel,
    make_texture,
    random_points,
    results_of,
    samples,
    texels,
    trilinear,
)

from warp_neural.errors import InputError
from warp_neural.imaging.block_encoders import encode_blocks
from warp_neural.kernels.texture.pages import PageParams, make_find, update_slots_kernel
from warp_neural.kernels.texture.tiles import make_encode_tiles_kernel
from warp_neural.texture.loaded import CodedMaps
from warp_neural.texture.virtual import VirtualTexture, mip_of

MIPS, TILE = 6, 8
FEW = MAPS[:3]
N = 7


@pytest.fixture(scope="module")
def texture(device):
    return make_texture(device, height=84, width=140, mips=MIPS, maps=FEW)


def tiles_of(texture, virtual):
    """Of pages in memory, what they hold and what they must, as words."""
    coded = CodedMaps(texture, virtual.tiles.bits)
    words, held, spec, side = coded.params.words.numpy(), virtual.params.words.numpy(), texture.state.spec, TILE + 1
    starts = coded.params.levels.texels.numpy()
    levels = [words[starts[m] :][: np.prod(spec.size(m))].reshape(*spec.size(m), -1) for m in range(MIPS)]
    slots = virtual.params.slots.numpy()
    assert (slots == virtual.cache.slot_of).all()
    pages = np.flatnonzero(slots >= 0)
    for page, mip in zip(pages, mip_of(virtual.first, pages), strict=True):
        height, width = spec.size(mip)
        row, column = np.divmod(page - virtual.first[mip], -(-width // TILE))
        rows, columns = ((TILE * at + np.arange(side)) % n for at, n in ((row, height), (column, width)))
        expected = levels[mip][rows[:, None], columns]
        yield held.reshape(-1, side, side, held.shape[-1])[slots[page]], expected


def warm(virtual, points, device):
    for _ in range(MIPS + 1):
        found = samples(virtual, points, N, device)
        if virtual.update().misses == 0:
            return found
    raise AssertionError("never warm")


@pytest.mark.parametrize("bits", [8, 16])
def test_a_warm_cache_gives_the_texture_on_load(texture, bits, device):
    virtual = VirtualTexture(texture, budget=10**6, tile=TILE, bits=bits)
    points = random_points(np.random.default_rng(2), 4000, MIPS)
    cold = samples(virtual, points, N, device)
    expected = samples(CodedMaps(texture, bits), points, N, device)
    assert (cold != expected).any()
    assert (warm(virtual, points, device) == expected).all()
    held = list(tiles_of(texture, virtual))
    assert len(held) > 100 and all((a == b).all() for a, b in held)


def memory_of(params):
    """Arrays of tiles, and of all else; all of 4 bytes a number."""
    levels = [getattr(params.levels, name) for name in params.levels._cls.vars]
    flat = [wp.array(array.numpy().ravel(), device="cpu") for array in levels]
    return [params.words], [params.slots, params.wanted, params.first, params.columns, *flat]


def test_tiles_in_blocks_are_those_of_an_encoder_of_files(texture, device):
    virtual = VirtualTexture(texture, budget=10**6, tile=TILE, bits=4)
    points = random_points(np.random.default_rng(2), 4000, MIPS)
    found = warm(virtual, points, device)
    plain = VirtualTexture(texture, budget=10**6, tile=TILE)
    assert 0.4 < virtual.params.words.size / plain.params.words.size * (9 / 12) ** 2 * 8 / 7 < 0.6
    expected = samples(CodedMaps(texture), points, N, device)
    assert 0 < np.abs(found - expected).max() <= 0.5 / 7 + 1 / 255 and np.abs(found - expected).mean() < 0.01
    words, side, spec = virtual.params.words.numpy(), TILE + 4, texture.state.spec
    for page in np.flatnonzero(virtual.cache.slot_of >= 0)[::7]:
        mip = mip_of(virtual.first, np.array([page]))[0]
        row, column = np.divmod(page - virtual.first[mip], -(-spec.size(mip)[1] // TILE))
        rows, columns = ((TILE * k + np.arange(side)) % n for k, n in zip((row, column), spec.size(mip), strict=True))
        values = decoded_levels(texture)[mip][rows[:, None], columns]
        held = words.reshape(-1, side**2 // 16, N, 2)[virtual.cache.slot_of[page]]
        for c in range(N):
            assert encode_blocks(values[..., c : c + 1], "bc4") == held[:, c].tobytes()


@cache
def find_kernel():
    find = make_find(TILE)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(params: PageParams, points: wp.array[wp.vec3], found: wp.array2d[int]):
        n = wp.tid()
        place = find(params, wp.vec2(points[n][0], points[n][1]), int(points[n][2]))
        found[n, 0] = place.slot
        found[n, 1] = place.mip

    return kernel


def needs(points, virtual, there):
    """By NumPy: of each point and both levels the pages wanted, in order, and the levels that are read."""
    spec, wanted, read = virtual.texture.state.spec, set(), []
    for u, v, lod in np.float32(points):
        lod = min(max(lod, np.float32(0)), np.float32(MIPS - 1))
        for mip in (int(lod), int(lod) + 1)[: 1 + int(lod % 1 > 0)]:
            for m in range(mip, MIPS):
                height, width = spec.size(m)
                i, j = (int(np.floor(x * np.float32(n) - np.float32(0.5))) % n for x, n in ((v, height), (u, width)))
                page = int(virtual.first[m]) + i // TILE * -(-width // TILE) + j // TILE
                if m == mip or there(page):
                    wanted.add(page)
                if there(page):
                    break
            read.append((mip, m))
    return sorted(wanted), read


@pytest.mark.parametrize("decodes", [None, 4])
def test_under_pressure_there_is_no_hole_no_stale_tile_and_no_other_use(texture, decodes, device):
    """A tenth of what a picture of the whole texture needs, and another view in every frame."""
    budget = VirtualTexture(texture, budget=10**9, tile=TILE).bytes // 10
    virtual = VirtualTexture(texture, budget=budget, tile=TILE)
    model, rng, evictions = Model(len(virtual.cache.page_of), virtual.cache.kept), np.random.default_rng(6), 0
    coarser = 0
    levels = [level.astype(np.float64) for level in decoded_levels(texture)]
    for frame in range(12):
        points = random_points(rng, 60, MIPS - 1) * [0.4, 0.4, 0.5] + [frame / 7, frame / 5, 0]
        wanted, read = needs(points, virtual, model.there)
        fallbacks = trilinear_of(levels, points, iter(read))
        np.testing.assert_allclose(samples(virtual, points, N, device), fallbacks, atol=2e-5)
        update, (misses, decoded, evicted) = virtual.update(decodes), model.want(wanted, decodes)
        assert update.__dict__ == {
            "wanted": len(wanted), "misses": misses, "decodes": len(decoded), "evictions": len(evicted)
        }  # fmt: skip
        assert all((a == b).all() for a, b in tiles_of(texture, virtual))
        found = wp.zeros((len(points), 2), dtype=int, device=device)
        inputs = [virtual.params, wp.array(np.maximum(points, 0), dtype=wp.vec3, device=device), found]
        wp.launch(find_kernel(), len(points), inputs, device=device)
        virtual.params.wanted.zero_()
        slots, mip = found.numpy().T
        assert slots.min() >= 0
        pages = virtual.cache.page_of[slots]
        assert (pages >= 0).all() and (mip_of(virtual.first, pages) == mip).all()
        evictions += update.evictions
        coarser += sum(m > mip for mip, m in read)
        assert virtual.bytes <= budget
        tiles, tables = (sum(array.size * 4 for array in arrays) for arrays in memory_of(virtual.params))
        assert virtual.bytes == tiles + tables and tiles > 0.8 * budget
    assert evictions > 10 and coarser > 10


def decoded_levels(texture):
    return [np.floor(np.clip(results_of(texture.decoder, mip), 0, 1) * 255 + 0.5) / 255 for mip in range(MIPS)]


def trilinear_of(levels, points, read):
    """Each level blended in place of which another is read."""
    result = []
    for point in np.float32(points):
        lod = np.clip(np.float64(point[2]), 0, MIPS - 1)
        total = 0.0
        for mip, share in ((int(lod), 1 - lod % 1), (int(lod) + 1, lod % 1)):
            if share > 0:
                asked, m = next(read)
                assert asked == mip
                total = total + share * trilinear(levels, [(point[0], point[1], m)])[0]
        result.append(total)
    return np.array(result)


def test_texels_of_pages_that_are_not_there_are_those_of_coarser_ones(texture, device):
    virtual, levels = VirtualTexture(texture, budget=10**6, tile=TILE), decoded_levels(texture)
    spec, rng = texture.state.spec, np.random.default_rng(5)
    places = np.stack([rng.integers(0, 84, 500), rng.integers(0, 140, 500), rng.integers(0, MIPS, 500)], axis=1)
    expected, last = [], []
    for i, j, mip in places:
        (height, width), m = spec.size(mip), max(mip, 4)  # 5 x 8 texels, the finest level of one tile
        expected.append(levels[mip][i % height, j % width])
        h, w = spec.size(m)
        last.append(levels[m][i % height * h // height, j % width * w // width])
    assert np.abs(texels(virtual, places, N, device) - last).max() < 1e-5
    assert virtual.update().misses > 50
    assert np.abs(texels(virtual, places, N, device) - expected).max() < 1e-5
    assert virtual.update().misses == 0


def test_everything_that_fits_stays(texture, device):
    virtual = VirtualTexture(texture, budget=10**9, tile=TILE)
    assert len(virtual.cache.page_of) == len(virtual.cache.slot_of)  # no more slots than pages
    points = random_points(np.random.default_rng(3), 5000, MIPS)
    warm(virtual, points, device)
    samples(virtual, points, N, device)
    update = virtual.update()
    assert update.wanted > 100 and (update.misses, update.decodes, update.evictions) == (0, 0, 0)


def test_a_texture_without_mips_is_there_as_a_whole(device):
    texture = make_texture(device, mips=1, maps=FEW)
    with pytest.raises(InputError, match=r"budget=10000: 35 tiles, the least, take \d+ bytes"):
        VirtualTexture(texture, budget=10000, tile=TILE)
    virtual = VirtualTexture(texture, budget=10**6, tile=TILE)
    points = random_points(np.random.default_rng(3), 500, 1)
    assert (samples(virtual, points, N, device) == samples(CodedMaps(texture), points, N, device)).all()
    assert virtual.update().misses == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [({"tile": 4}, "tile=4"), ({"tile": 18}, "tile=18: expected a multiple of 4"), ({"bits": 5}, "bits=5")],
)
def test_bad_options_are_refused(texture, options, message):
    with pytest.raises(InputError, match=message):
        VirtualTexture(texture, budget=10**6, **options)


def test_compiles_for_hopper(texture, tmp_path):
    virtual = VirtualTexture(texture, budget=10**6, tile=TILE)
    blocks = VirtualTexture(texture, budget=10**6, tile=TILE, bits=4)
    kernels = [make_samples_kernel(each.sample, each.Params, N) for each in (virtual, blocks)]
    kernels += [make_texels_kernel(virtual.texel, virtual.Params, N)]
    kernels += [make_encode_tiles_kernel(blocks.tiles), update_slots_kernel]
    for kernel in kernels:
        (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path / kernel.key)
        assert artifact.stat().st_size > 0
