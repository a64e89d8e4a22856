"""Textures decoded on load: texels and samples are those of the maps that lie in memory, in codes and in blocks."""

import numpy as np
import pytest
import texture2ddecoder
import warp as wp
from texture_maps import (
    MAPS,
    channels_of,
    make_samples_kernel,
    make_texture,
    random_points,
    results_of,
    samples,
    texels,
    trilinear,
)

from warp_neural.errors import InputError
from warp_neural.imaging.block_files import load_blocks
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.loaded import BlockMaps, CodedMaps

RNG = np.random.default_rng(4)
MIPS, N = 4, 16


@pytest.fixture(scope="module")
def texture(device):
    return make_texture(device)


def every_place(spec):
    """(i, j, mip) of all texels, some of them from repeats beside the texture, and of a level that is not there."""
    places = [(i, j, mip) for mip in range(spec.mips) for i, j in np.ndindex(*spec.size(mip))]
    height, width = spec.size(spec.mips - 1)
    return np.array([*places, (-1, -1, 0), (spec.height, -3, 0), (2 * height, 5 * width, 99)], np.int32)


def expected_texels(levels, places):
    return np.array([levels[min(mip, MIPS - 1)][i % h, j % w] for i, j, mip in places
                     for h, w in [levels[min(mip, MIPS - 1)].shape[:2]]])  # fmt: skip


def coded_levels(texture, bits):
    """By NumPy, from what the decoder gives."""
    most, maps = 2**bits - 1, texture.state.maps
    results = [results_of(texture.decoder, mip) for mip in range(MIPS)]
    rounded = [np.float32(np.floor(np.clip(y, 0, 1) * np.float32(most) + np.float32(0.5))) / most for y in results]
    return [channels_of(maps, to_maps(level, maps)) for level in rounded]


@pytest.mark.parametrize("bits", [8, 16])
def test_codes(texture, bits, device):
    maps, levels = CodedMaps(texture, bits), coded_levels(texture, bits)
    places = every_place(texture.state.spec)
    expected = expected_texels(levels, places)
    assert expected.std(axis=0).min() > 0.02
    np.testing.assert_allclose(texels(maps, places, N, device), expected, rtol=1e-5, atol=1e-6)
    points = random_points(RNG, 500, MIPS)
    np.testing.assert_allclose(samples(maps, points, N, device), trilinear(levels, points), rtol=1e-4, atol=2e-5)
    words = sum(level.shape[0] * level.shape[1] for level in levels) * N * bits // 8
    assert words < maps.bytes < words + 600  # tables of levels


def test_sixteen_bits_are_the_texture_itself(texture, device):
    points = random_points(RNG, 500, MIPS)
    found, expected = (samples(each, points, N, device) for each in (CodedMaps(texture, 16), texture))
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=2e-4)


def test_a_texture_of_other_bits_is_refused(texture):
    with pytest.raises(InputError, match="bits=12: expected 8 or 16"):
        CodedMaps(texture, 12)


def block_levels(maps, spec):
    """What an independent decoder makes of the blocks, as channels."""
    levels = []
    for mip in range(spec.mips):
        (height, width), arrays = spec.size(mip), {}
        for each, encoded in zip(MAPS, maps.encoded.values(), strict=True):
            if encoded.format.startswith("half"):
                components = 1 if encoded.format == "half1" else 4
                values = np.float32(np.frombuffer(encoded.levels[mip], "<f2").reshape(height, width, components))
            else:
                pixels = getattr(texture2ddecoder, f"decode_{encoded.format}")(encoded.levels[mip], width, height)
                values = np.frombuffer(pixels, np.uint8).reshape(height, width, 4)[..., [2, 1, 0, 3]] / np.float32(255)
            if encoded.format == "bc5":
                values = values.copy()
                x, y = 2 * values[..., 0] - 1, 2 * values[..., 1] - 1
                values[..., 2] = 0.5 + 0.5 * np.sqrt(np.maximum(1 - x**2 - y**2, 0))
            arrays[each.name] = values[..., [0, 3]] if each.channels == 2 else values
        levels.append(channels_of(MAPS, arrays))
    return levels


@pytest.mark.parametrize("bc1", [False, True])
def test_blocks(texture, bc1, device):
    maps = BlockMaps(texture, bc1=bc1)
    formats = [each.format for each in maps.encoded.values()]
    colours = ["bc1", "bc3", "bc3"] if bc1 else ["bc7"] * 3
    assert formats == [colours[0], "bc5", "bc4", "half4", *colours[1:], "half1"]
    levels, places = block_levels(maps, texture.state.spec), every_place(texture.state.spec)
    np.testing.assert_allclose(texels(maps, places, N, device), expected_texels(levels, places), rtol=1e-6, atol=1e-6)
    points = random_points(RNG, 500, MIPS)
    np.testing.assert_allclose(samples(maps, points, N, device), trilinear(levels, points), rtol=1e-4, atol=2e-5)
    words = sum(len(level) + -len(level) % 4 for each in maps.encoded.values() for level in each.levels)
    assert words < maps.bytes < words + 800  # tables of levels and maps


def test_blocks_are_near_the_texture(texture, device):
    points = random_points(RNG, 500, MIPS)
    found, expected = (samples(each, points, N, device) for each in (BlockMaps(texture), texture))
    names = dict(zip(range(N), (each.name for each in MAPS for _ in each.trained), strict=True))
    for c in range(N):
        if names[c] != "normal":  # these of noise are no unit vectors
            assert np.abs(found[:, c] - expected[:, c]).mean() < 0.3 * max(expected[:, c].std(), 0.02), names[c]


@pytest.mark.parametrize("file", ["dds", "ktx2"])
def test_blocks_go_to_files(texture, file, tmp_path):
    maps = BlockMaps(texture, bc1=True)
    paths = maps.save(tmp_path, file)
    assert [path.name for path in paths] == [f"{each.name}.{file}" for each in MAPS]
    for path, (name, encoded) in zip(paths, maps.encoded.items(), strict=True):
        found = load_blocks(path)
        assert (found.format, found.srgb, found.levels) == (encoded.format, encoded.srgb, encoded.levels), name


@pytest.mark.parametrize("make", [CodedMaps, BlockMaps, lambda texture: BlockMaps(texture, bc1=True)])
def test_compiles_for_hopper(texture, make, tmp_path):
    maps = make(texture)
    kernel = make_samples_kernel(maps.sample, maps.Params, N)
    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0
