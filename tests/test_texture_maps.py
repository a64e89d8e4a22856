"""From pictures to what a neural texture learns and back: values as stored, kinds by names, what is refused."""

import numpy as np
import pytest
from texture_pictures import RNG, back, codes, folder, kinds, put

from warp_neural.errors import InputError
from warp_neural.imaging.exr import save_exr
from warp_neural.imaging.image import srgb_to_linear
from warp_neural.materials.default_material import default_material
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.maps import TextureSet, load_set

__all__ = ["folder"]  # a fixture


def test_a_folder_as_stored(folder):
    path, made = folder
    texture_set = load_set(path)
    assert kinds(texture_set) == {
        "albedo": "srgb",
        "normal_dx": "normal",
        "gloss": "linear",
        "opacity": "mask",
        "wear mask": "mask",
        "emissive": "srgb",
        "flow": "linear",
    }
    assert texture_set.values.shape == (6, 10, 15) and texture_set.values.dtype == np.float32
    assert texture_set.values.flags.c_contiguous and texture_set.size == (6, 10) and texture_set.channels == 15
    for name, values in back(texture_set).items():
        assert (values == made[name]).all(), name
    assert {each.name: each.bits for each in texture_set.maps if each.bits != 8} == {"gloss": 16}
    assert texture_set.maps[0].file == "Rock_2K-PNG_Color.png" and texture_set.name == path.name


def test_maps_may_be_chosen_and_only_these_are_read(folder):
    path, _made = folder
    (path / "rock_disp.png").write_text("damaged")
    chosen = load_set(path, maps=("flow", "albedo"))
    assert [each.name for each in chosen.maps] == ["albedo", "flow"] and chosen.channels == 6
    with pytest.raises(InputError, match=r"--maps colour: .* holds albedo, .*flow.*; give some of these"):
        load_set(path, maps=("colour",))
    with pytest.raises(InputError, match=r"rock_disp.png: its content is no known image"):
        load_set(path)


def test_packed_channels_are_maps_of_their_own(tmp_path):
    packed = put(tmp_path / "brick_arm.png", codes(4, 4, 3))
    smooth = put(tmp_path / "MetallicSmoothness.png", codes(4, 4, 4))
    maps = back(load_set([tmp_path / "brick_arm.png"]))
    assert list(maps) == ["ao", "roughness", "metalness"]
    assert all((maps[name][..., 0] == packed[..., k]).all() for k, name in enumerate(maps))
    maps = back(load_set(str(tmp_path / "MetallicSmoothness.png")))
    assert (maps["metalness"][..., 0] == smooth[..., 0]).all() and (maps["gloss"][..., 0] == smooth[..., 3]).all()
    put(tmp_path / "brick_orm.png", codes(4, 4))
    with pytest.raises(InputError, match=r"brick_orm.png: has no channel for the ao"):
        load_set([tmp_path / "brick_orm.png"])


def test_what_is_left_out_is_said(tmp_path):
    for name in ("a_NormalGL.png", "a_NormalDX.png", "a_rough.png", "a_gloss.png", "preview.png"):
        put(tmp_path / name, codes(4, 4, 3))
    save_exr(tmp_path / "maps.exr", dict.fromkeys(("R", "G", "B", "normal.X", "normal.Y"), codes(4, 4)))
    texture_set = load_set(tmp_path)
    assert kinds(texture_set) == {"normal": "normal", "roughness": "linear"}
    assert set(texture_set.unused) == {"a_NormalDX.png", "a_gloss.png", "maps.exr"}


def test_grey_stored_as_rgb_is_one_channel(tmp_path):
    grey = codes(5, 4)
    put(tmp_path / "albedo.png", np.dstack([grey] * 3))
    nearly = np.dstack([grey, grey, np.clip(grey + 2 / 255, 0, 1)])  # as lossy formats leave it
    put(tmp_path / "roughness.png", nearly)
    put(tmp_path / "other.png", nearly)
    put(tmp_path / "over.png", np.dstack([grey, grey, grey, codes(5, 4)]))
    put(tmp_path / "opaque.png", np.dstack([codes(5, 4, 3), np.ones((5, 4))]).astype(np.float32))
    texture_set = load_set(tmp_path)
    counts = {each.name: each.channels for each in texture_set.maps}
    assert counts == {"albedo": 1, "roughness": 1, "opaque": 3, "other": 3, "over": 2}
    assert (back(texture_set)["roughness"][..., 0] == grey).all()


def test_constant_channels_are_exact_and_not_trained(tmp_path):
    values = codes(4, 4, 3)
    values[..., 1] = np.float32(77 / 255)
    albedo = put(tmp_path / "albedo.png", values)
    put(tmp_path / "ao.png", np.ones((4, 4)))
    texture_set = load_set(tmp_path)
    assert texture_set.channels == 2 and [each.trained for each in texture_set.maps] == [(0, 2), ()]
    assert texture_set.maps[0].low == (0, float(albedo[0, 0, 1]), 0)
    wrong = to_maps(texture_set.values + 0.5, texture_set.maps)
    assert (wrong["albedo"][..., 1] == albedo[..., 1]).all() and (wrong["ao"] == 1).all()
    assert wrong["albedo"].max() <= 1


@pytest.mark.parametrize("value", [0.0, 0.3, 7.0, -2.0, 9e15])
def test_where_nothing_varies_one_channel_is_trained(value):
    texture_set = load_set({"a": np.full((1, 1, 3), value), "b": np.zeros((1, 1))})
    assert texture_set.channels == 1 and texture_set.size == (1, 1)
    assert np.abs(back(texture_set)["a"] - np.float32(value)).max() <= 1e-6 * abs(value)


def test_hdr_is_logarithms(tmp_path):
    values = np.float32(np.exp(RNG.normal(0, 3, (16, 16, 3))))
    values[0, 0] = 0
    values[..., 2] = 2.5
    put(tmp_path / "sky.exr", values)
    texture_set = load_set(tmp_path)
    (sky,) = texture_set.maps
    assert sky.kind == "hdr" and sky.trained == (0, 1) and sky.low[2] == sky.high[2] == 2.5
    dark = 2 ** sky.low[0]
    assert dark == pytest.approx(np.median(values[values > 0]) / 64, rel=1e-6)
    logs = np.log2(values[..., :2].astype(np.float64) + dark)
    expected = (logs - sky.low[0]) / (sky.high[0] - sky.low[0])
    assert np.abs(texture_set.values - expected).max() < 1e-6
    assert 0 <= texture_set.values.min() and texture_set.values.max() <= 1
    found = back(texture_set)["sky"]
    assert (np.abs(found - values) <= 1e-5 * (values + dark)).all() and (found[0, 0, :2] == 0).all()


FLOATS = [
    ("height.exr", codes(4, 4) * 30 - 3, "linear"),  # its own range
    ("height.exr", codes(4, 4), "linear"),
    ("albedo.exr", codes(4, 4, 3), "hdr"),  # linear light
    ("photo.hdr", codes(4, 4, 3) * 9, "hdr"),
    ("depth.exr", codes(4, 4) * 9, "hdr"),
    ("curvature.exr", codes(4, 4) * 2 - 1, "linear"),
    ("normal.exr", codes(4, 4, 3), "normal"),
    ("normal.exr", codes(4, 4, 3) * 2 - 1, "linear"),
]


@pytest.mark.parametrize(("name", "values", "kind"), FLOATS)
def test_floats_keep_their_range(tmp_path, name, values, kind):
    stored = put(tmp_path / name, values)
    texture_set = load_set(tmp_path)
    (each,) = texture_set.maps
    assert each.kind == kind
    found = back(texture_set)[each.name]
    assert np.abs(found - stored).max() <= 2e-6 * np.abs(stored).max()
    assert texture_set.values.min() >= 0 and texture_set.values.max() <= 1
    if kind == "linear" and (stored.min() < 0 or stored.max() > 1):
        assert (each.low, each.high) == ((stored.min(),) * each.channels, (stored.max(),) * each.channels)


def test_arrays():
    arrays = {
        "albedo": RNG.integers(0, 256, (8, 4, 3), dtype=np.uint8),
        "height": RNG.integers(0, 65536, (8, 4), dtype=np.uint16),
        "glow": RNG.random((8, 4, 2)),
        "cut mask": RNG.random((8, 4)) < 0.5,
    }
    texture_set = load_set(arrays)
    assert kinds(texture_set) == {"albedo": "srgb", "height": "linear", "glow": "linear", "cut mask": "mask"}
    assert [each.bits for each in texture_set.maps] == [8, 16, 16, 8]
    found = back(texture_set)
    assert (found["albedo"] == np.float32(arrays["albedo"] / 255)).all()
    assert (found["height"][..., 0] == np.float32(arrays["height"] / 65535)).all()
    assert (found["glow"] == np.float32(arrays["glow"])).all()
    assert load_set(texture_set) is texture_set


def test_a_material(tmp_path):
    material = default_material(16)
    texture_set = load_set(material)
    assert texture_set.name == "default" and texture_set.channels == 9  # metalness and opacity are constant
    found = back(texture_set)
    assert np.abs(srgb_to_linear(found["albedo"]) - material.albedo).max() < 1e-6
    assert np.abs(2 * found["normal"] - 1 - material.normal).max() < 1e-6
    assert (found["opacity"] == 1).all() and list(found) == list(material.maps())


def test_unequal_sizes_are_refused_or_resized(tmp_path):
    put(tmp_path / "albedo.png", np.broadcast_to([0.5, 0.6, 0.7], (8, 4, 3)))
    put(tmp_path / "ao.png", codes(4, 2))
    with pytest.raises(InputError, match=r"unequal sizes, albedo.png 4 x 8, ao.png 2 x 4; give .*--resize 4x8"):
        load_set(tmp_path)
    assert load_set(tmp_path, resize="largest").size == (8, 4)
    small = load_set(tmp_path, resize=(3, 5))
    assert small.size == (5, 3) and [each.trained for each in small.maps] == [(), (0,)]
    assert np.abs(back(small)["albedo"] - [0.5, 0.6, 0.7]).max() < 3e-3
    for size in ((0, 4), (4, 16385)):
        with pytest.raises(InputError, match=rf"--resize {size[0]}x{size[1]}: give sides of 1 to 16384"):
            load_set(tmp_path, resize=size)


def test_sixteen_channels_and_no_more():
    arrays = {f"m{k}": RNG.random((2, 2)) for k in range(17)}
    assert load_set(arrays, maps=tuple(arrays)[:16]).channels == 16
    assert load_set(arrays | {"m3": np.ones((2, 2))}).channels == 16  # a constant is none
    with pytest.raises(InputError, match=r"17 channels \(m0 1, .*m16 1\); at most 16 in one texture: name fewer with"):
        load_set(arrays)


REFUSED = [
    ({}, "no maps"),
    ([], "no maps"),
    (7, "a source of type int"),
    ([7], "a source of type list"),
    ({"../a": np.ones((2, 2))}, "no name for a file"),
    ({"": np.ones((2, 2))}, "no name for a file"),
    ({"a": np.ones((2, 2, 5))}, r"map a: an array of shape \(2, 2, 5\)"),
    ({"a": np.ones((0, 2))}, "shape"),
    ({"a": np.ones((2, 2), np.int64)}, "values of type int64"),
    ({"a": np.full((2, 2), np.nan)}, "map a: NaN"),
    ({"a": np.full((2, 2), 1e200)}, "map a: NaN or infinite"),
    ({"a": np.full((2, 2), 1e19)}, r"a: values from 1e\+19 to 1e\+19; bring them below"),
    ({"albedo": np.array([[[-5.0, 1, 1]]])}, "albedo: colours from -5 to 1; clip"),
    ({"a": np.ones((1, 16385))}, "16385 x 1 texels; at most 16384"),
]


@pytest.mark.parametrize(("source", "message"), REFUSED)
def test_bad_sources(source, message):
    with pytest.raises(InputError, match=message) as error:
        load_set(source)
    assert "\n" not in str(error.value)


def test_bad_folders(tmp_path):
    with pytest.raises(InputError, match=r"none: not a readable folder"):
        load_set(tmp_path / "none")
    with pytest.raises(InputError, match=r"holds no picture"):
        load_set(tmp_path)
    put(tmp_path / "a.png", codes(2, 2))
    put(tmp_path / "A.jpg", codes(2, 2))
    with pytest.raises(InputError, match=r"A.jpg and a.png could each be the map a; leave one"):
        load_set(tmp_path)
    save_exr(tmp_path / "b.exr", {"Y": np.float32([[np.inf]])})
    with pytest.raises(InputError, match=r"b.exr: holds NaN or infinite values"):
        load_set([tmp_path / "b.exr"])


def test_real_materials(shared_data):
    texture_set = load_set(shared_data / "materials" / "PavingStones070")
    assert isinstance(texture_set, TextureSet) and texture_set.values.shape == (1024, 1024, 8)
    assert kinds(texture_set) == {"albedo": "srgb", "normal": "normal", "roughness": "linear", "ao": "linear"}
    codes = texture_set.values * 255
    assert (np.abs(codes - np.rint(codes)) < 1e-4).all()
