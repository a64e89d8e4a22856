"""Mip chains and other sizes: means of light, vectors and coverage, odd sizes, levels given as folders."""

import numpy as np
import pytest
from PIL import Image

from warp_neural.errors import InputError
from warp_neural.imaging.exr import save_exr
from warp_neural.imaging.image import linear_to_srgb, save_image, srgb_to_linear
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.maps import load_set, mip_chain, without_hidden
from warp_neural.texture.resample import resample, to_light

RNG = np.random.default_rng(5)


def unit(shape):
    vectors = RNG.normal([0, 0, 2], 1, (*shape, 3))
    return np.float32(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True) / 2 + 0.5)


def mean_of_shares(values, height, width):
    """[height, width, channels], by adding up every old texel's share of each new one."""
    result = np.zeros((height, width, values.shape[-1]))
    for y in range(height):
        for x in range(width):
            for i in range(values.shape[0]):
                for j in range(values.shape[1]):
                    rows = [max(y * values.shape[0], i * height), min((y + 1) * values.shape[0], (i + 1) * height)]
                    columns = [max(x * values.shape[1], j * width), min((x + 1) * values.shape[1], (j + 1) * width)]
                    if rows[1] > rows[0] and columns[1] > columns[0]:
                        result[y, x] += (rows[1] - rows[0]) * (columns[1] - columns[0]) * values[i, j]
    return result / (values.shape[0] * values.shape[1])


@pytest.mark.parametrize("size", [(4, 4), (7, 5), (9, 1), (2, 6)])
def test_every_texel_is_the_mean_of_its_share(size):
    values = np.float32(RNG.random((*size, 2)))
    new = max(size[0] // 2, 1), max(size[1] // 2, 1)
    assert np.abs(resample(values, "linear", new) - mean_of_shares(values, *new)).max() < 1e-6


def test_a_chain_of_all_kinds():
    arrays = {
        "albedo": np.float32(RNG.random((7, 12, 3))),
        "normal": unit((7, 12)),
        "opacity": RNG.random((7, 12)) < 0.4,
        "sky": np.float32(np.exp(RNG.normal(0, 2, (7, 12, 3)))),
    }
    texture_set = load_set(arrays)
    levels = mip_chain(texture_set)
    assert [level.shape for level in levels] == [(7, 12, 10), (3, 6, 10), (1, 3, 10), (1, 1, 10)]
    assert all(level.dtype == np.float32 and level.min() >= 0 and level.max() <= 1 for level in levels)
    maps = [to_maps(level, texture_set.maps) for level in levels]
    for k, name, kind in ((1, "albedo", "srgb"), (3, "albedo", "srgb"), (1, "sky", "hdr"), (3, "opacity", "mask")):
        light = to_light(maps[0][name], kind)
        expected = mean_of_shares(light, *levels[k].shape[:2])
        assert to_light(maps[k][name], kind) == pytest.approx(expected, rel=3e-5), (k, name)
    vectors = mean_of_shares(2 * arrays["normal"] - 1, 3, 6)
    expected = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    assert np.abs(2 * maps[1]["normal"] - 1 - expected).max() < 1e-5
    assert len(mip_chain(texture_set, 2)) == 2
    for count in (0, 5):
        with pytest.raises(InputError, match=f"{count} mip levels: 12 x 7 texels have 1 to 4"):
            mip_chain(texture_set, count)


def test_one_texel():
    assert [level.shape for level in mip_chain(load_set({"a": np.ones((1, 1))}))] == [(1, 1, 1)]


def test_colours_do_not_bleed_from_where_alpha_is_0():
    leaf = np.zeros((2, 2, 4), np.float32)  # black around one green texel
    leaf[0, 0] = 0.2, 0.7, 0.1, 1
    texture_set = load_set({"albedo": leaf})
    mean = to_maps(mip_chain(texture_set)[1], texture_set.maps)["albedo"][0, 0]
    assert mean[3] == 0.25 and np.abs(mean[:3] - leaf[0, 0, :3]).max() < 2e-3
    hidden = np.float32(RNG.random((4, 4, 4)))
    hidden[..., 3] = 0
    expected = linear_to_srgb(mean_of_shares(srgb_to_linear(hidden[..., :3]), 1, 1))
    assert np.abs(resample(hidden, "srgb", (1, 1))[..., :3] - expected).max() < 1e-5


def test_larger_by_a_cubic():
    x = np.linspace(0, 1, 9, dtype=np.float32)
    line = resample(x[None, :, None].repeat(3, axis=0), "linear", (3, 36))[1, :, 0]
    places = (np.arange(36) + 0.5) / 4 - 0.5
    assert np.abs(line - places / 8)[8:-8].max() < 1e-6  # exact on straight lines, away from the edges
    values = np.float32(RNG.random((9, 9)))
    theirs = np.asarray(Image.fromarray(values).resize((27, 27), Image.Resampling.BICUBIC))
    ours = resample(values[..., None], "linear", (27, 27))[..., 0]
    inner = slice(9, 18)  # Pillow leaves taps beyond the edge out
    assert np.abs(ours - np.clip(theirs, values.min(), values.max()))[inner, inner].max() < 1e-5
    normals = resample(unit((3, 3)), "normal", (7, 2))
    assert np.abs(np.linalg.norm(2 * normals - 1, axis=-1) - 1).max() < 1e-5


def test_where_masked_out_any_value_will_do():
    mask = np.zeros((8, 8), bool)
    mask[0, 2] = True
    texture_set = load_set({"ao": RNG.random((8, 8)), "opacity": mask, "roughness": RNG.random((8, 8))})
    levels = mip_chain(texture_set)
    free = without_hidden(levels, texture_set.maps)
    seen = np.zeros((8, 8), bool)
    seen[[7, 0, 1], 1:4] = True  # with all texels beside it, across the border too
    assert (~np.isnan(free[0][..., 0]) == seen).all() and (~np.isnan(free[0][..., 2]) == seen).all()
    assert (free[0][seen] == levels[0][seen]).all()
    for a, b in zip(free, levels, strict=True):
        assert (a[..., 1] == b[..., 1]).all()
    assert not np.isnan(free[-1]).any()
    worn = load_set({"ao": RNG.random((8, 8)), "wear mask": mask})  # hides nothing
    assert without_hidden([worn.values], worn.maps)[0] is worn.values
    whole = load_set({"ao": RNG.random((8, 8)), "opacity": np.ones((8, 8), bool)})
    assert without_hidden([whole.values], whole.maps)[0] is whole.values


def put_levels(folder, sizes, names=("albedo", "specular")):
    """As `samples.mipmap` leaves them."""
    for k, size in enumerate(sizes):
        for name in names:
            channels = 3 if name == "albedo" else 1
            values = np.ones((*size, 1)) if (k, name) == (0, "specular") else RNG.random((*size, channels))
            save_image(folder / f"level_{k}" / f"{name}.png", values, color_space="linear", bits=16)
        save_exr(folder / f"level_{k}" / "maps.exr", dict.fromkeys(("R", "G", "B", "specular"), np.ones(size, "f4")))
    return folder


def test_levels_may_be_given(tmp_path):
    texture_set = load_set(put_levels(tmp_path, [(8, 4), (4, 2), (2, 1)]))
    assert texture_set.channels == 4 and len(texture_set.levels) == 3  # specular is constant in the first one only
    assert texture_set.name == tmp_path.name and texture_set.unused == ("maps.exr",)
    levels = mip_chain(texture_set)
    assert [level.shape for level in levels] == [(8, 4, 4), (4, 2, 4), (2, 1, 4), (1, 1, 4)]
    assert all((a == b).all() for a, b in zip(levels, texture_set.levels, strict=False))
    assert np.abs(levels[3][0, 0, 3] - levels[2][..., 3].mean()) < 1e-6
    assert (levels[0][..., 3] == 1).all()
    assert len(mip_chain(texture_set, 2)) == 2


def test_given_levels_are_whole_and_halve(tmp_path):
    put_levels(tmp_path / "a", [(8, 4), (4, 3)])
    with pytest.raises(InputError, match=r"level_1, albedo.png: 3 x 4 texels, 3 channels; levels halve.*: 2 x 4, 3"):
        load_set(tmp_path / "a")
    put_levels(tmp_path / "b", [(8, 4), (4, 2)])
    (tmp_path / "b" / "level_1" / "specular.png").unlink()
    with pytest.raises(InputError, match=r"level_1: has no specular, which level_0 has"):
        load_set(tmp_path / "b")
    assert load_set(tmp_path / "b", maps=("albedo",)).channels == 3
    with pytest.raises(InputError, match=r"mip levels that are given are not resized"):
        load_set(tmp_path / "b", maps=("albedo",), resize=(4, 4))
