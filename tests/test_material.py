"""Decoding, defaults, what bad folders say, and the default material."""

from dataclasses import replace

import numpy as np
import OpenEXR
import pytest

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_exr, save_exr, save_image, srgb_to_linear
from warp_neural.materials.default_material import default_material
from warp_neural.materials.material import DEFAULTS, RINGING, Material, find_maps, load_material, save_material


def save(folder, name, value, size=(8, 8), **options):
    """A picture of one colour; encoded values unless `options` say otherwise."""
    pixels = np.broadcast_to(np.float32(value), (*size, *np.shape(value)))
    save_image(folder / name, pixels, **{"color_space": "linear", **options})


def refused(folder, words, action=load_material):
    with pytest.raises(InputError, match=words) as caught:
        action(folder)
    assert "\n" not in str(caught.value) and str(folder) in str(caught.value)


def test_values_are_decoded(tmp_path):
    save(tmp_path, "T_1K-PNG_Color.png", (0.2, 0.4, 0.6), bits=16)
    save(tmp_path, "T_1K-PNG_NormalGL.png", (0.5, 0.9, 0.9), bits=16)
    save(tmp_path, "T_1K-PNG_NormalDX.png", (0.5, 0.1, 0.9), bits=16)  # beside the other it is not read
    save(tmp_path, "T_1K-PNG_Roughness.jpg", (0.2, 0.2, 0.2))
    save(tmp_path, "T_1K-PNG_Displacement.exr", 7.5)
    save(tmp_path, "T.png", 0.1, size=(3, 3))
    material = load_material(tmp_path)
    assert material.name == tmp_path.name and material.resolution == (8, 8)
    assert material.albedo[0, 0] == pytest.approx(srgb_to_linear(np.array([0.2, 0.4, 0.6])), abs=1e-4)
    assert material.normal[0, 0] == pytest.approx([0, 0.5**0.5, 0.5**0.5], abs=1e-4)
    assert material.roughness[0, 0] == pytest.approx(0.2, abs=0.01)
    assert material.height[0, 0] == 7.5
    assert all(value.dtype == np.float32 for value in material.maps().values())


def test_lone_directx_normal_is_flipped(tmp_path):
    save(tmp_path, "wall_nor_dx_1k.png", (0.5, 0.1, 0.9), bits=16)
    assert load_material(tmp_path).normal[0, 0] == pytest.approx([0, 0.5**0.5, 0.5**0.5], abs=1e-4)


def test_missing_maps_get_the_stated_values(tmp_path):
    save(tmp_path, "roughness.png", 1.0)
    material = load_material(tmp_path)
    for name, value in material.maps().items():
        assert np.all(value == (1.0 if name == "roughness" else DEFAULTS[name]))
    assert np.allclose(np.linalg.norm(material.normal, axis=-1), 1)


def test_alpha_is_opacity_unless_there_is_a_map(tmp_path):
    save(tmp_path, "albedo.png", (0.5, 0.5, 0.5, 0.2), bits=16)
    assert load_material(tmp_path).opacity == pytest.approx(0.2, abs=1e-4)
    save(tmp_path, "opacity.png", 1.0)
    assert np.all(load_material(tmp_path).opacity == 1)


def test_albedo_of_a_float_file_is_linear(tmp_path):
    save(tmp_path, "albedo.exr", 0.25)
    assert np.all(load_material(tmp_path).albedo == 0.25)


def test_folders_without_maps(tmp_path):
    refused(tmp_path / "none", "not a readable folder")
    (tmp_path / "notes.txt").write_text("")
    save(tmp_path, "holiday.png", 0.5)
    refused(tmp_path, "no map.*color.*nor_gl.*displacement")


def test_several_files_for_one_map(tmp_path):
    for first, second in (("albedo.png", "x_Color.jpg"), ("x_rough_1k.png", "x_rough_2k.png")):
        save(tmp_path, first, 0.5)
        save(tmp_path, second, 0.5)
        refused(tmp_path, f"({first} and {second}|{second} and {first}) could each")
        (tmp_path / first).unlink()
        (tmp_path / second).unlink()
    save(tmp_path, "normal.png", (0.5, 0.5, 1))
    save(tmp_path, "x_NormalGL.png", (0.5, 0.5, 1))
    refused(tmp_path, "could each be the normal")


def test_unequal_sizes(tmp_path):
    save(tmp_path, "albedo.png", 0.5)
    save(tmp_path, "roughness.png", 0.5, size=(8, 4))
    refused(tmp_path, "albedo.png 8 x 8 and roughness.png 4 x 8")


@pytest.mark.parametrize("value", [-0.25, -0.06, 1.06, 1.5, np.nan])
@pytest.mark.parametrize("name", ["albedo", "roughness", "normal"])
def test_float_maps_out_of_range(tmp_path, name, value):
    pixels = np.full((8, 8), 0.9, np.float32)
    pixels[0, 0] = value
    save_exr(tmp_path / f"{name}.exr", dict.fromkeys("RGB", pixels))
    refused(tmp_path, f"{name}.exr: .*(values from|NaN)")


def test_ringing_of_lossy_codecs_is_clipped(tmp_path):
    sharp = (np.random.default_rng(0).random((64, 64)) ** 0.1).astype(np.float32)
    for name in ("albedo", "metalness", "ao"):
        save_exr(tmp_path / f"{name}.exr", dict.fromkeys("RGB", sharp), compression=OpenEXR.DWAA_COMPRESSION)
    assert 1.002 < load_exr(tmp_path / "ao.exr")["R"].max() < 1 + RINGING
    save_exr(
        tmp_path / "normal.exr",
        dict(zip("RGB", [0 * sharp + 0.5, 0 * sharp + 0.5, sharp * 0 + 1 + RINGING], strict=True)),
    )
    material = load_material(tmp_path)
    for name in ("albedo", "metalness", "ao"):
        assert 0 <= material.maps()[name].min() and material.maps()[name].max() == 1
    assert np.all(material.normal == [0, 0, 1])


def test_normals_without_direction(tmp_path):
    for value in ((0, 0, 0), (0.5, 0.5, 0.5), (0.5, 0.5, 0)):
        save(tmp_path, "normal.png", value)
        refused(tmp_path, "normal.png: 100% of the normals")
    save(tmp_path, "normal.png", 0.5)
    refused(tmp_path, "3 channels")


def test_the_odd_bad_normal_becomes_flat(tmp_path):
    normal = np.full((16, 16, 3), (0.5, 0.7, 0.9), np.float32)
    normal[3, 4] = 0
    save_image(tmp_path / "normal.png", normal, color_space="linear")
    assert load_material(tmp_path).normal[3, 4].tolist() == [0, 0, 1]


def test_save_and_load(tmp_path):
    material = default_material(32)
    save_material(tmp_path / "new" / "folder", material)
    read = load_material(tmp_path / "new" / "folder")
    assert find_maps(tmp_path / "new" / "folder").keys() == DEFAULTS.keys()
    for name, value in read.maps().items():
        assert np.abs(value - material.maps()[name]).max() < 5e-5, name
    (tmp_path / "file").write_text("")
    refused(tmp_path / "file", "cannot write", lambda path: save_material(path, material))


def test_crop_is_the_middle():
    material = default_material(32)
    part = material.crop(8)
    assert part.resolution == (8, 8) and np.array_equal(part.normal, material.normal[12:20, 12:20])
    for size in (0, 33):
        with pytest.raises(InputError, match="32 x 32"):
            material.crop(size)


def test_maps_must_be_of_one_size():
    maps = default_material(32).maps()
    with pytest.raises(InputError, match="ao has shape"):
        Material("odd", **{**maps, "ao": maps["ao"][1:]})


def test_default_material():
    material = default_material()
    assert material.resolution == (512, 512) and default_material(600).resolution == (600, 600)
    again = default_material(64)
    assert all(np.array_equal(again.maps()[name], value) for name, value in material.crop(64).maps().items())
    assert np.allclose(np.linalg.norm(material.normal, axis=-1), 1, atol=1e-6) and material.normal[..., 2].min() > 0.2
    low, middle, high = np.percentile(material.roughness, [1, 50, 99])
    assert 0.28 <= low < middle < 0.45 and 0.8 < high <= 0.92
    blocks = material.normal.reshape(128, 4, 128, 4, 3).mean(axis=(1, 3))
    assert np.linalg.norm(blocks, axis=-1).mean() < 0.975  # normals that a mip map cannot keep
    wet = replace(material, roughness=0.4 * material.roughness)
    assert wet.roughness.max() < 0.37
    for size in (3, 5000):
        with pytest.raises(InputError, match="choose a size"):
            default_material(size)


def test_real_materials(shared_data):
    for folder in sorted((shared_data / "materials").iterdir()):
        files = find_maps(folder)
        assert {path.stem for path in files.values()} == set(files)  # plain names
    material = load_material(shared_data / "materials" / "PavingStones070")
    assert material.resolution == (1024, 1024) and material.normal[..., 2].min() > 0
    assert 0.4 < material.roughness.min() < material.roughness.max() < 0.8
