"""MaterialX documents written here, read as layered materials."""

import sys

import numpy as np
import pytest

from warp_neural import InputError
from warp_neural.imaging.image import save_image
from warp_neural.kernels.materials.spec import LayeredSpec
from warp_neural.materials.layered import LayeredSet
from warp_neural.materials.materialx import load_materialx

pytest.importorskip("MaterialX", reason="MaterialX is not installed; pip install 'warp-neural[materialx]'")


def document(shader: str, inputs: str, graph: str = "", more: str = "") -> str:
    return f"""<?xml version="1.0"?>
<materialx version="1.38" colorspace="lin_rec709">
  <nodegraph name="graph">{graph}</nodegraph>
  <{shader} name="shader" type="surfaceshader">{inputs}</{shader}>
  <surfacematerial name="tile" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="shader"/>
  </surfacematerial>{more}
</materialx>"""


@pytest.fixture
def load(tmp_path):
    """Of a document's text, beside `picture.png` of 4 x 6 texels."""
    picture = np.random.default_rng(0).random((4, 6, 3), np.float32)
    save_image(tmp_path / "picture.png", picture, color_space="linear", bits=16)

    def read(text, **options):
        (tmp_path / "tile.mtlx").write_text(text)
        return load_materialx(tmp_path / "tile.mtlx", **options)

    read.picture = picture
    return read


def test_open_pbr_of_constants(load):
    inputs = """
    <input name="base_color" type="color3" value="0.5, 0.25, 0.125"/>
    <input name="base_weight" type="float" value="0.5"/>
    <input name="specular_ior" type="float" value="1.5"/>
    <input name="specular_roughness" type="float" value="0.4"/>
    <input name="coat_weight" type="float" value="0.75"/>
    <input name="coat_color" type="color3" value="1, 0.5, 0.25"/>"""
    material = load(document("open_pbr_surface", inputs))
    expected = {"color": (0.25, 0.125, 0.0625), "specular": 0.5, "roughness": 0.4, "coat": 0.75, "metalness": 0.0}
    expected |= {"coat_color": (1, 0.5, 0.25), "coat_specular": (0.6 / 2.6) ** 2 / 0.08, "anisotropy": 0.0}
    for name, value in expected.items():
        np.testing.assert_allclose(material.inputs[name], np.ravel(value), rtol=1e-5, err_msg=name)
    assert not material.maps and material.layers["coat"] and not material.layers["anisotropic"]


def test_standard_surface_of_nodes(load):
    """Tiled, in a graph with an interface, multiplied and mixed; normals scaled, rotation in turns."""
    graph = """
    <input name="roughest" type="float" value="0.5"/>
    <tiledimage name="tiles" type="color3">
      <input name="file" type="filename" value="picture.png" colorspace="srgb_texture"/>
      <input name="uvtiling" type="vector2" value="2, 3"/>
    </tiledimage>
    <image name="grey" type="float"><input name="file" type="filename" value="picture.png"/></image>
    <multiply name="rough" type="float">
      <input name="in1" type="float" nodename="grey"/>
      <input name="in2" type="float" interfacename="roughest"/>
    </multiply>
    <constant name="red" type="color3"><input name="value" type="color3" value="1, 0, 0"/></constant>
    <mix name="mixed" type="color3">
      <input name="fg" type="color3" nodename="red"/>
      <input name="bg" type="color3" nodename="tiles"/>
      <input name="mix" type="float" value="0.25"/>
    </mix>
    <image name="bumps" type="vector3"><input name="file" type="filename" value="picture.png"/></image>
    <normalmap name="normals" type="vector3">
      <input name="in" type="vector3" nodename="bumps"/>
      <input name="scale" type="float" value="0.5"/>
    </normalmap>
    <output name="out_color" type="color3" nodename="mixed"/>
    <output name="out_rough" type="float" nodename="rough"/>
    <output name="out_normal" type="vector3" nodename="normals"/>"""
    inputs = """
    <input name="base_color" type="color3" nodegraph="graph" output="out_color"/>
    <input name="specular_roughness" type="float" nodegraph="graph" output="out_rough"/>
    <input name="normal" type="vector3" nodegraph="graph" output="out_normal"/>
    <input name="specular_anisotropy" type="float" value="0.5"/>
    <input name="specular_rotation" type="float" value="0.125"/>"""
    material = load(document("standard_surface", inputs, graph))
    assert material.maps == ("color", "normal", "roughness")
    encoded = load.picture
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    mixed = 0.75 * np.tile(linear, (3, 2, 1)) + 0.25 * np.array([1, 0, 0])
    np.testing.assert_allclose(material.inputs["color"], mixed, atol=1e-4)
    np.testing.assert_allclose(material.inputs["roughness"][..., 0], 0.5 * encoded[..., 0], atol=1e-4)
    normal = (encoded * 2 - 1) * [0.5, 0.5, 1]
    normal[..., 2] = np.maximum(normal[..., 2], 0.05)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    np.testing.assert_allclose(material.inputs["normal"], normal, atol=2e-3)  # 16 bits, where the normal is short
    np.testing.assert_allclose(material.inputs["tangent"], [0, 1], atol=1e-6)
    assert material.name == "tile"
    assert LayeredSet(material, device="cpu").spec == LayeredSpec(material.maps, anisotropic=True)


SHADER = "standard_surface"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (document("disney_brdf_2015", ""), r"node shader \(disney_brdf_2015\): not read"),
        (
            document(
                SHADER,
                '<input name="base" type="float" nodegraph="graph" output="o"/>',
                '<noise2d name="speck" type="float"/><output name="o" type="float" nodename="speck"/>',
            ),
            r"node graph/speck \(noise2d\): not read; there are image, tiledimage",
        ),
        (document(SHADER, '<input name="sheen" type="float" value="0.5"/>'), "input sheen is not read; leave it 0"),
        (document(SHADER, '<input name="bass" type="float" value="0.5"/>'), "input bass is not read; leave it out"),
        (document(SHADER, '<input name="tangent" type="vector3" value="1, 0, 0"/>'), "input tangent is not read"),
        (document(SHADER, '<input name="base" type="float" nodename="gone"/>'), "base is connected to what is not"),
        (
            document(
                SHADER,
                '<input name="base_color" type="color3" nodename="i"/>',
                more='<image name="i" type="color3"><input name="file" type="filename" value="no.png"/></image>',
            ),
            "no.png",
        ),
        (document(SHADER, "", more='<surfacematerial name="b" type="material"/>'), "choose one of tile, b"),
        ("<materialx version='1.38'/>", "has no material"),
        ("no xml", "not a readable MaterialX document"),
    ],
)
def test_what_is_not_read_is_named(load, text, message):
    with pytest.raises(InputError, match=message):
        load(text)


def test_files_from_a_folder_above(load, tmp_path):
    """As in MaterialX's library, whose documents say `resources/Images/` with a prefix."""
    (tmp_path / "deep" / "er").mkdir(parents=True)
    graph = """<image name="grey" type="float"><input name="file" type="filename" value="picture.png"/></image>
    <output name="o" type="float" nodename="grey"/>"""
    text = document(SHADER, '<input name="coat" type="float" nodegraph="graph" output="o"/>', graph)
    (tmp_path / "deep" / "er" / "tile.mtlx").write_text(text)
    material = load_materialx(tmp_path / "deep" / "er" / "tile.mtlx")
    np.testing.assert_allclose(material.inputs["coat"][..., 0], load.picture[..., 0], atol=1e-4)


def test_one_of_several_materials(load):
    more = """
  <open_pbr_surface name="other" type="surfaceshader">
    <input name="base_metalness" type="float" value="1"/>
  </open_pbr_surface>
  <surfacematerial name="b" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="other"/>
  </surfacematerial>"""
    text = document(SHADER, "", more=more)
    assert load(text, material="b").inputs["metalness"] == 1 and load(text, material="tile").inputs["metalness"] == 0
    with pytest.raises(InputError, match="has no material c; there are tile, b"):
        load(text, material="c")


def test_without_the_package_it_is_named(load, monkeypatch):
    monkeypatch.setitem(sys.modules, "MaterialX", None)
    with pytest.raises(InputError, match=r"needs pip install 'warp-neural\[materialx\]'"):
        load(document(SHADER, ""))
