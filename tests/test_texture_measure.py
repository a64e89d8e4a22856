"""Errors of decoded textures against their definitions."""

import json
from dataclasses import replace

import numpy as np
import pytest

from warp_neural.texture.kinds import to_maps, to_network
from warp_neural.texture.maps import load_set
from warp_neural.texture.measure import angle, channel_errors, flip, map_errors, psnr, relative_error, ssim

RNG = np.random.default_rng(7)


def noisy(values, sigma=0.02):
    return values + np.float32(RNG.normal(0, sigma, values.shape))


def test_psnr_is_of_8_bit_codes():
    assert psnr(np.zeros((2, 2)), np.full((2, 2), 0.4 / 255)) == 120  # the same code
    assert psnr(np.zeros(4), np.full(4, 0.6 / 255)) == pytest.approx(20 * np.log10(255), abs=1e-5)
    assert psnr(np.ones(4), np.full(4, 3.0)) == 120  # clipped
    a, b = RNG.integers(0, 256, (2, 9, 9, 2)).astype(np.float64)
    assert psnr(a / 255, b / 255) == pytest.approx(10 * np.log10(255**2 / np.mean((a - b) ** 2)), abs=1e-5)


def test_errors_by_channel_map_and_all():
    texture_set = load_set({"albedo": RNG.random((16, 16, 3)), "ao": RNG.random((16, 16)), "one": np.ones((16, 16))})
    truth, maps = texture_set.values, texture_set.maps
    result = noisy(truth)
    errors = channel_errors(truth, result, maps)
    assert list(errors["maps"]) == ["albedo", "ao"]  # a constant is exact
    assert errors["psnr"] == pytest.approx(psnr(truth, result))
    assert errors["maps"]["albedo"]["psnr"] == pytest.approx(psnr(truth[..., :3], result[..., :3]))
    assert errors["maps"]["albedo"]["channels"][2] == pytest.approx(psnr(truth[..., 2], result[..., 2]))
    assert errors["maps"]["ao"]["channels"] == [errors["maps"]["ao"]["psnr"]]


def test_pictures_are_compared_as_shown():
    sky = np.float32(np.exp(RNG.normal(0, 2, (24, 24, 3))))
    texture_set = load_set({"albedo": RNG.random((24, 24, 4)), "sky": sky, "rough": RNG.random((24, 24))})
    truth, maps = texture_set.values, texture_set.maps
    same = map_errors(truth, truth, maps)
    result = noisy(truth, 0.05)
    errors = json.loads(json.dumps(map_errors(truth, result, maps)))
    for name, row in same["maps"].items():
        assert row["psnr"] == 120 and row["ssim"] == pytest.approx(1) and row["flip"] < 1e-6
        assert errors["maps"][name]["flip"] > 0.02 and errors["maps"][name]["ssim"] < 0.99
    assert same["maps"]["sky"]["relative"] == 0 and "relative" not in errors["maps"]["rough"]
    found, dark = to_maps(result, maps)["sky"].astype(np.float64), 2 ** maps[1].low[0]
    expected = np.sqrt(np.mean(((found - sky) / (sky + dark)) ** 2))
    assert errors["maps"]["sky"]["relative"] == pytest.approx(expected, rel=1e-4)


def test_a_step_of_the_logarithm_is_a_ratio():
    sky = np.float32(np.exp(RNG.normal(5, 1, (8, 8, 1))))
    (each,) = load_set({"sky": sky}).maps
    wrong = to_maps(to_network(sky, each) + 0.01, (each,))["sky"]
    ratio = 2 ** (0.01 * (each.high[0] - each.low[0]))
    inner = sky < sky.max() / ratio  # the others are clipped
    assert (wrong + 2 ** each.low[0])[inner] == pytest.approx(((sky + 2 ** each.low[0]) * ratio)[inner], rel=1e-4)
    assert relative_error(sky, 1.1 * sky, 0) == pytest.approx(0.1, rel=1e-5)


def test_a_constant_channel_of_hdr_has_no_logarithm():
    """Its value is no end of the range: the errors are those of the channel that varies, alone."""
    bright = np.float32(np.random.default_rng(4).random((16, 16, 1)) * 900 + 100)
    alone = load_set({"sky": bright, "ao": np.float32(bright > 500)}, maps=["sky"])
    (each,) = alone.maps
    both = replace(each, low=(*each.low, 0.25), high=(*each.high, 0.25))
    assert both.trained == (0,) and both.span == each.span and each.span[0] > 0.25
    changed = np.clip(alone.values + np.float32(0.02), 0, 1)
    one, two = (map_errors(alone.values, changed, [m])["maps"]["sky"] for m in (each, both))
    errors = np.square([one["relative"], two["relative"]])
    assert errors[1] == pytest.approx(errors[0] / 2)  # the mean over two channels, of which one is exact


def test_angles_of_normals():
    flat = np.float32([[[0.5, 0.5, 1]]])
    assert angle(flat, np.float32([[[1, 0.5, 0.5]]])) == pytest.approx(90)
    small = np.radians(0.01)
    turned = np.array([[[np.sin(small), 0, np.cos(small)]]]) * 0.9 / 2 + 0.5
    assert angle(flat, turned) == pytest.approx(0.01, rel=1e-6)
    texture_set = load_set({"normal": RNG.random((12, 12, 3))})
    errors = map_errors(texture_set.values, texture_set.values, texture_set.maps)
    assert errors["maps"]["normal"]["degrees"] == pytest.approx(0, abs=1e-5)


def test_hidden_texels_do_not_count():
    truth, result = RNG.random((2, 8, 8, 2))
    hidden = truth.copy()
    hidden[:4, :, 0] = np.nan
    maps = load_set({"a": truth[..., :1], "b": truth[..., 1:]}).maps
    errors = channel_errors(hidden, result, maps)
    assert errors["maps"]["a"]["psnr"] == pytest.approx(psnr(truth[4:, :, 0], result[4:, :, 0]))
    assert errors["maps"]["b"]["psnr"] == pytest.approx(psnr(truth[..., 1], result[..., 1]))


def test_small_and_grey_pictures():
    grey = np.float32(RNG.random((10, 40, 1)))
    assert ssim(grey, grey) is None and flip(grey, grey) < 1e-6
    assert ssim(grey.repeat(2, axis=0), grey.repeat(2, axis=0)) == pytest.approx(1)
    assert flip(grey, 1 - grey) == pytest.approx(flip(grey.repeat(3, axis=-1), 1 - grey.repeat(3, axis=-1)))
