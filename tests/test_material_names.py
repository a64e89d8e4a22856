"""Which file is read for which map: the names of every scheme, packed maps, and what is left."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from warp_neural.errors import InputError
from warp_neural.imaging.image import save_image
from warp_neural.materials.choice import choose_maps
from warp_neural.materials.material import DEFAULTS, load_material
from warp_neural.materials.naming import WORDS, read_name
from warp_neural.samples.mipmap.maps import MaterialConfig, source_maps

AMBIENT_CG = {
    "Color": "albedo",
    "NormalGL": "normal",
    "NormalDX": "normal",
    "Roughness": "roughness",
    "Metalness": "metalness",
    "AmbientOcclusion": "ao",
    "Displacement": "height",
    "Opacity": "opacity",
}
POLY_HAVEN = {
    "diff": "albedo",
    "nor_gl": "normal",
    "nor_dx": "normal",
    "rough": "roughness",
    "metal": "metalness",
    "ao": "ao",
    "disp": "height",
    "alpha": "opacity",
}
PACKED = ("ao", "roughness", "metalness")
SCHEMES = [  # file names as they come from each place, and what they hold
    ("fabric_pattern_07_col_01_4k.png", "albedo"),
    ("brick_wall_arm_2k.jpg", *PACKED),
    ("Wood_Base_color.png", "albedo"),  # Substance
    ("lambert1_BaseColor.1001.exr", "albedo"),
    ("M_Wall_OcclusionRoughnessMetallic.png", *PACKED),
    ("Crate_AlbedoTransparency.png", "albedo"),
    ("Crate_MetallicSmoothness.png", "metalness", "roughness"),
    ("Crate_MaskMap.tif", "metalness", "ao", "roughness"),
    ("Wall_Normal_OpenGL.png", "normal"),
    ("Wall_Normal_DirectX.png", "normal"),
    ("Wall_Mixed_AO.png", "ao"),
    ("tdzjebjg_2K_Metalness.jpg", "metalness"),  # Quixel
    ("tdzjebjg_2K_Gloss.jpg", "roughness"),
    ("tdzjebjg_4K_Normal_LOD0.exr", "normal"),
    ("rusty-metal_metallic.png", "metalness"),  # FreePBR
    ("rusty-metal_normal-ogl.png", "normal"),
    ("rusty-metal_normal-dx.png", "normal"),
    ("metal_0081_normal_opengl_4k.jpg", "normal"),  # TextureCan
    ("metal_0081_metallic_4k.jpg", "metalness"),
    ("WaterBottle_occlusionRoughnessMetallic.png", *PACKED),  # glTF
    ("Default_metalRoughness.jpg", "roughness", "metalness"),
    ("SciFiHelmet_MetallicRoughness.png", "roughness", "metalness"),
    ("FlightHelmet_Lens_OcclusionRoughMetal.png", *PACKED),
    ("T_Rock_D.png", "albedo"),  # Unreal
    ("T_Rock_N.png", "normal"),
    ("T_Rock_ORM.png", *PACKED),
    ("Rock_N.png",),
    ("Bricks_COL_3K.jpg", "albedo"),  # Poliigon
    ("Bricks_COL_VAR2_3K.jpg", "albedo"),
    ("Bricks_NRM_2K_METALNESS.png", "normal"),
    ("Bricks_METALNESS_2K_METALNESS.png", "metalness"),
    ("wall_spec_2k.png",),  # maps that the shader does not take
    ("wall_Emission.png",),
    ("protocol.png",),
    ("brick_diffuse_1024x1024.png", "albedo"),
]


def maps_of(file_name):
    name = read_name(file_name.rpartition(".")[0])
    return tuple(part.map for part in name.parts) if name else ()


def save(folder, *names, value=0.5, size=(8, 8)):
    """Pictures of one colour, as encoded."""
    for name in names:
        pixels = np.broadcast_to(np.float32(value), (*size, *np.shape(value)))
        save_image(folder / name, pixels, color_space="linear", **({} if ".jpg" in name else {"bits": 16}))


@given(
    st.from_regex(r"[A-Z][A-Za-z]{1,9}[0-9]{3}", fullmatch=True),
    st.sampled_from(["1K", "2K-JPG", "4K-PNG", "8K"]),
    st.sampled_from(sorted(AMBIENT_CG)),
    st.sampled_from([".jpg", ".PNG", ".exr"]),
)
def test_names_of_ambientcg(asset, resolution, word, suffix):
    assert maps_of(f"{asset}_{resolution}_{word}{suffix}") == (AMBIENT_CG[word],)
    assert maps_of(f"{asset}{suffix}") == ()  # the preview beside the maps


@given(
    st.lists(st.sampled_from(["brick", "rough", "metal", "wall", "diff", "02"]), min_size=1, max_size=3),
    st.sampled_from(sorted(POLY_HAVEN)),
    st.sampled_from(["_1k", "_4k", "_16k", ""]),
)
def test_names_of_poly_haven(asset, word, resolution):
    assert maps_of(f"{'_'.join(asset)}_{word}{resolution}.png") == (POLY_HAVEN[word],)


@pytest.mark.parametrize("name", DEFAULTS)
def test_plain_names(name):
    assert maps_of(f"{name}.jpg") == maps_of(f"{name.upper()}.TIF") == maps_of(f"My wood_{name}.png") == (name,)
    assert maps_of(f"{name}s.jpg") == maps_of(f"not{name}.jpg") == ()


@pytest.mark.parametrize(("name", "maps"), [(name, tuple(maps)) for name, *maps in SCHEMES])
def test_names_of_other_schemes(name, maps):
    assert maps_of(name) == maps


def test_every_word_is_its_own_map():
    for word, parts in WORDS.items():
        for spelt in (word, word.replace("_", ""), word.replace("_", "-").upper()):
            assert read_name(spelt).parts == read_name(f"Wall_{spelt}_2k").parts == parts


@pytest.mark.parametrize("name", ["x_arm.png", "x_orm_2k.tif", "x_OcclusionRoughnessMetallic.png"])
def test_packed_maps(tmp_path, name):
    save(tmp_path, name, value=(0.2, 0.4, 0.6))
    material = load_material(tmp_path)
    for map_name, value, channel in zip(PACKED, (0.2, 0.4, 0.6), ("red", "green", "blue"), strict=True):
        assert material.maps()[map_name] == pytest.approx(value, abs=1e-4)
        assert material.files[map_name] == f"{name} ({channel} channel)"
    assert np.all(material.height == DEFAULTS["height"]) and material.unused == ()


def test_gltf_and_unity_packing(tmp_path):
    save(tmp_path, "x_MetallicRoughness.png", value=(0.2, 0.4, 0.6))
    material = load_material(tmp_path)
    assert material.roughness == pytest.approx(0.4, abs=1e-4) and material.metalness == pytest.approx(0.6, abs=1e-4)
    assert np.all(material.ao == 1)  # glTF says nothing of red
    (tmp_path / "x_MetallicRoughness.png").unlink()
    save(tmp_path, "x_MaskMap.png", value=(0.2, 0.4, 0.6, 0.3))
    material = load_material(tmp_path)
    assert material.roughness == pytest.approx(0.7, abs=1e-4) and material.metalness == pytest.approx(0.2, abs=1e-4)
    assert material.ao == pytest.approx(0.4, abs=1e-4)
    assert material.files["roughness"] == "x_MaskMap.png (alpha channel, inverted)"
    save(tmp_path, "x_MaskMap.png", value=(0.2, 0.4, 0.6))
    with pytest.raises(InputError, match=r"MaskMap.png: has no channel for the roughness"):
        load_material(tmp_path)


def test_own_files_come_before_packed_ones(tmp_path):
    save(tmp_path, "x_arm_1k.png", value=(0.2, 0.4, 0.6))
    save(tmp_path, "x_rough_1k.png", value=0.9)
    material = load_material(tmp_path)
    assert material.roughness == pytest.approx(0.9, abs=1e-4) and material.metalness == pytest.approx(0.6, abs=1e-4)
    save(tmp_path, "x_ao_1k.png", "x_metal_1k.png")
    assert load_material(tmp_path).unused == ("x_arm_1k.png",)


def test_gloss_is_turned_over(tmp_path):
    save(tmp_path, "x_GLOSS_2K.png", value=0.2)
    material = load_material(tmp_path)
    assert material.roughness == pytest.approx(0.8, abs=1e-4)
    assert material.files == {"roughness": "x_GLOSS_2K.png (inverted)"}
    save(tmp_path, "x_Roughness.png", value=0.3)
    material = load_material(tmp_path)
    assert material.roughness == pytest.approx(0.3, abs=1e-4) and material.unused == ("x_GLOSS_2K.png",)


@pytest.mark.parametrize(
    "name", ["x_normal-dx.png", "x_Normal_DirectX.png", "x_NormalDX.png", "T_x_N.png", "x_nor_dx.png"]
)
def test_normals_of_directx_are_flipped(tmp_path, name):
    save(tmp_path, name, value=(0.5, 0.1, 0.9))
    material = load_material(tmp_path)
    assert material.normal[0, 0] == pytest.approx([0, 0.5**0.5, 0.5**0.5], abs=1e-4)
    assert material.files["normal"] == f"{name} (DirectX, green flipped)"
    save(tmp_path, "x_normal-ogl.png", value=(0.5, 0.9, 0.9))
    material = load_material(tmp_path)
    assert material.normal[0, 0] == pytest.approx([0, 0.5**0.5, 0.5**0.5], abs=1e-4) and material.unused == (name,)


def test_the_lowest_variant_is_read(tmp_path):
    save(tmp_path, "x_col_02_1k.png", "x_col_03_1k.png", value=(0.1, 0.1, 0.1))
    save(tmp_path, "x_col_01_1k.png", value=(0.9, 0.9, 0.9))
    material = load_material(tmp_path)
    assert material.files["albedo"] == "x_col_01_1k.png"
    assert material.unused == ("x_col_02_1k.png", "x_col_03_1k.png")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("albedo.png", "x_Color.jpg"),
        ("x_rough_1k.png", "x_rough_2k.png"),
        ("x_ao.png", "x_ao.jpg"),
        ("x_arm.png", "x_orm.png"),
        ("x_col_01.png", "y_col_02.png"),
        ("x_diff.png", "x_col_01.png"),
        ("x_BaseColor.1001.png", "x_BaseColor.1002.png"),
    ],
)
def test_several_files_for_one_map_are_refused_by_name(tmp_path, first, second):
    save(tmp_path, first, second, value=(0.5, 0.5, 0.5))
    with pytest.raises(InputError, match=f"({first} and {second}|{second} and {first}) could each"):
        load_material(tmp_path)


def test_every_other_picture_is_named(tmp_path):
    save(tmp_path, "Rock01_2K-PNG_Color.png", "Rock01_2K-PNG_Emission.png", "holiday.tif", value=(0.5, 0.5, 0.5))
    save(tmp_path, "Rock01.png", "Rock01_Preview.jpg", "x_thumb.png", "sphere.png", size=(3, 3))  # previews
    (tmp_path / "._Rock01_2K-PNG_Roughness.png").write_bytes(b"\0\5\x16\7")  # macOS's companion
    (tmp_path / "notes.txt").write_text("")
    material = load_material(tmp_path)
    assert material.unused == choose_maps(tmp_path).unused == ("Rock01_2K-PNG_Emission.png", "holiday.tif")
    line = material.sources()
    assert "albedo from Rock01_2K-PNG_Color.png" in line and "\n" not in line
    assert "no normal, roughness, metalness, ao, height, opacity" in line
    assert line.endswith("NOT USED: Rock01_2K-PNG_Emission.png, holiday.tif")


def test_folders_of_maps_one_level_down(tmp_path):
    (tmp_path / "textures").mkdir()
    with pytest.raises(InputError, match=r"holds no map .its folders are textures.*albedo: albedo, color"):
        load_material(tmp_path)


def test_the_sample_says_which_maps_it_learns(tmp_path, capsys):
    save(tmp_path, "x_diff.png", "x_nothing.png", value=(0.5, 0.5, 0.5))
    _name, maps = source_maps(MaterialConfig(material=tmp_path), wp.get_device("cpu"))
    assert maps.shape == (8, 8)
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"material {tmp_path.name}: albedo from x_diff.png; no normal, roughness")
    assert line.endswith("NOT USED: x_nothing.png")
