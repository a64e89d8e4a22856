"""Neural textures for sampling: latents of few bits, packed in memory as they are counted."""

import numpy as np
import pytest
import warp as wp

import warp_neural as wn
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.kernels.texture.texel import make_latent
from warp_neural.texture.decoder import pack
from warp_neural.texture.presets import FIXED, fixed_spec

RNG = np.random.default_rng(5)


@pytest.mark.parametrize(("bits", "resident"), [(1, 1), (2, 2), (3, 4), (4, 4), (5, 8), (8, 8)])
def test_packed_latents_come_back(bits, resident):
    grid = Grid(4, 3, bits=bits)
    latents = RNG.integers(-grid.limit, grid.limit + 1, (5, 7, 3)).astype(np.int8)
    if bits == 1:
        latents = np.where(latents < 0, -1, 1).astype(np.int8)
    words, latent = pack(grid, latents), make_latent(grid)
    assert len(words) == -(-latents.size * resident // 32) and grid.resident_bits == resident

    @wp.kernel(module="unique")
    def read(words: wp.array[wp.uint32], values: wp.array[float]):
        values[wp.tid()] = latent(words, 2, wp.tid())  # two words of others before

    values = wp.zeros(latents.size, dtype=float, device="cpu")
    packed = wp.array(np.insert(words, 0, [7, 9]), dtype=wp.uint32, device="cpu")
    wp.launch(read, latents.size, [packed, values], device="cpu")
    np.testing.assert_array_equal(values.numpy(), latents.ravel())


@pytest.mark.parametrize("bits", FIXED)
def test_presets_take_the_bits_of_their_names(bits):
    spec = fixed_spec(256, 256, 8, 1, bits)
    assert spec.resident_bits == bits and spec.grids == FIXED[bits]
    assert fixed_spec(256, 256, 8, 1, bits + 0.01).grids == FIXED[bits]


def test_all_levels_count():
    assert fixed_spec(256, 256, 8, 9, 1.7).grids == FIXED[1.0625]
    spec = TextureSpec(64, 32, 3, 2, (Grid(2, 5, bits=3), Grid(8, 2, bits=1)))
    assert spec.resident_bits == (4 * 5 * (512 + 128) + 2 * (32 + 8)) / 2048


def test_compressed_for_sampling(tmp_path):
    picture = np.clip(0.5 + 0.3 * np.sin(np.arange(48) / 4)[:, None, None] * np.ones((48, 32, 3)), 0, 1)
    picture[..., 1] *= np.linspace(0, 1, 32)
    texture = wn.texture.compress({"albedo": picture}, bpp=1.1, storage="sample", steps=300, device="cpu", quiet=True)
    metrics = texture.metrics
    assert metrics["resident_bits"] == 1.0625 and metrics["rate_weight"] == 0 and metrics["psnr"] > 27
    latents = texture.params.latents.size * 32
    assert latents == 1.0625 * 48 * 32  # whole words here
    assert 8 * texture.save(tmp_path / "a.wntc")["all"] < latents + 8 * 40_000  # the network's
    again = wn.texture.load(tmp_path / "a.wntc", "cpu")
    np.testing.assert_array_equal(again.decode()["albedo"], texture.decode()["albedo"])
    assert [*texture.state.spec.grids] == [*FIXED[1.0625]] == [*again.state.spec.grids]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bpp": 0.1}, "at least 0.5 bits"),
        ({"psnr": 30}, 'psnr=30.*storage "sample"'),
        ({"size": 10_000}, 'size=10000.*storage "sample"'),
        ({"storage": "disk"}, "storage='disk'"),
    ],
)
def test_goals_that_sampling_does_not_have(options, message):
    options = {"storage": "sample", "device": "cpu"} | options
    with pytest.raises(wn.InputError, match=message):
        wn.texture.compress({"albedo": RNG.random((32, 32, 3))}, **options)
