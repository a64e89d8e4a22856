"""`perf.texture_codecs` at toy size: sizes by hand, the choice of qualities, the sphere, and where we lose."""

import json
import shutil

import numpy as np
import pytest
import warp as wp

from perf import texture_codecs, texture_peers, texture_points, texture_sphere
from perf.texture_peers import Coded
from perf.texture_points import OURS, RTXNTC, Judge, Point
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image, save_exr
from warp_neural.materials.default_material import default_material
from warp_neural.materials.material import save_material

PEERS = ("etcpak", "quicktex", "texture2ddecoder")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("material")
    save_material(folder, default_material(64))
    return folder


@pytest.fixture(scope="module")
def maps(folder):
    return texture_points.load_maps(folder, None)


def test_maps_are_as_stored(folder, maps):
    assert list(maps) == ["albedo", "normal", "roughness", "metalness", "ao", "height", "opacity"]
    expected = load_image(folder / "roughness.png", color_space="linear") * 255
    assert np.abs(maps["roughness"] - expected).max() <= 0.501 and maps["albedo"].shape == (64, 64, 3)
    assert texture_points.load_maps(folder, 20)["normal"].shape == (20, 20, 3)
    assert (texture_points.load_maps(folder, 20)["ao"] == maps["ao"][22:42, 22:42]).all()


def test_alpha_is_a_map_of_its_own():
    stored = {"decal": np.full((2, 3, 4), (0, 0.5, 1, 0.2), np.float32), "a": np.ones((2, 3, 2), np.float32)}
    codes = texture_points.codes_of(stored)
    assert {name: pixels.shape[2] for name, pixels in codes.items()} == {
        "decal": 3,
        "decal alpha": 1,
        "a": 1,
        "a alpha": 1,
    }
    assert codes["decal"][0, 0].tolist() == [0, 128, 255] and (codes["decal alpha"] == 51).all()


def test_maps_beyond_8_bits(tmp_path):
    save_exr(tmp_path / "height.exr", {"Y": np.linspace(-2, 3, 64, dtype=np.float32).reshape(8, 8)})
    with pytest.raises(InputError, match=r"height go beyond \[0, 1\]"):
        texture_points.load_maps(tmp_path, None)


def test_block_formats(maps):
    for name in PEERS:
        pytest.importorskip(name)
    maps = {name: maps[name][:62, :61] for name in ("albedo", "normal", "roughness", "ao")}  # 16 x 16 blocks
    coded = {each.setting: each for each in texture_peers.block_formats(maps)}
    sizes = {"BC1": 3 * 8, "BC1, BC4": 4 * 8, "BC1, BC5, BC4": 2 * 8 + 16 + 8}
    sizes |= {"BC7": 3 * 16, "BC7, BC4": 2 * 16 + 16, "BC7, BC5, BC4": 2 * 16 + 16}
    assert {setting: each.size for setting, each in coded.items()} == {k: 256 * v for k, v in sizes.items()}
    judge = Judge(maps, wp.get_device("cpu"))
    for each in coded.values():
        assert {name: pixels.shape for name, pixels in each.maps.items()} == {n: p.shape for n, p in maps.items()}
        assert judge.point(each).figures["PSNR"] > 24
    assert np.abs(coded["BC7, BC4"].maps["ao"].astype(int) - maps["ao"]).max() < 20


def test_normals_from_two_channels():
    xy = np.array([[[128, 128, 0], [255, 128, 0], [255, 255, 0]]], np.uint8)
    assert texture_peers.with_z(xy)[0, :, 2].tolist() == [255, 128, 128]


@pytest.mark.parametrize("name", texture_peers.PICTURES)
def test_picture_formats(maps, name):
    maps = {each: maps[each] for each in ("albedo", "roughness")}
    coded = texture_peers.pictures(name, maps)
    sizes = [each.size for each in coded]
    assert sizes == sorted(set(sizes)) and len(sizes) > 2
    errors = [sum(np.square(maps[k].astype(float) - p).sum() for k, p in each.maps.items()) for each in coded]
    assert errors == sorted(errors, reverse=True)


def test_smaller(maps):
    half, quarter, eighth = texture_peers.smaller({"ao": maps["ao"]})
    assert (half.size, quarter.size, eighth.size) == (32 * 32, 16 * 16, 8 * 8)
    flat = {"ao": np.full((9, 7, 1), 77, np.uint8)}
    assert all(
        (each.maps["ao"] == 77).all() and each.maps["ao"].shape == (9, 7, 1) for each in texture_peers.smaller(flat)
    )


def test_judge(maps):
    judge = Judge(maps, wp.get_device("cpu"))
    same = judge.point(Coded("a", "", 512, maps))
    assert same.bits == 1 and same.figures["PSNR"] == 120 and same.figures["ao SSIM"] == 1
    assert same.figures["albedo FLIP"] == same.figures["sphere FLIP"] == 0
    off = maps | {"roughness": np.where(maps["roughness"] > 127, maps["roughness"] - 10, maps["roughness"] + 10)}
    point = judge.point(Coded("b", "", 512, off))
    channels = sum(pixels.shape[2] for pixels in maps.values())
    assert point.figures["PSNR"] == pytest.approx(10 * np.log10(255**2 / (100 / channels)))
    assert point.figures["roughness PSNR"] == pytest.approx(10 * np.log10(255**2 / 100))
    assert point.figures["sphere FLIP"] > 0.001 and point.figures["albedo FLIP"] == 0


def test_sphere_is_lit_by_its_normals():
    """Flat maps: brightest where the sphere faces the light, black beside it; a bent normal moves the brightness."""
    flat = {"normal": np.full((64, 64, 3), (128, 128, 255), np.uint8), "ao": np.full((64, 64, 1), 255, np.uint8)}
    picture = texture_sphere.render(flat, wp.get_device("cpu")).sum(-1)
    i, j = np.unravel_index(picture.argmax(), picture.shape)
    light = np.array(texture_sphere.LIGHT) / np.linalg.norm(texture_sphere.LIGHT)
    half = light + np.array([0, 0, 1])
    half /= np.linalg.norm(half)
    assert np.hypot(32 + 32 * half[0] - j, 32 - 32 * half[1] - i) < 12 and picture[0, 0] == 0
    right = flat | {"normal": np.full((64, 64, 3), (200, 128, 230), np.uint8)}
    bent = texture_sphere.render(right, wp.get_device("cpu")).sum(-1)
    assert (bent * np.arange(64)).sum() / bent.sum() < (picture * np.arange(64)).sum() / picture.sum() - 2


def test_where_we_lose():
    ours = [Point(OURS, "", bits, {"PSNR": psnr, "FLIP": 0.1}) for bits, psnr in ((1, 30), (4, 34))]
    beside = [Point("A", "", 2, {"PSNR": 31.9, "FLIP": 0.09}), Point("B", "", 8, {"PSNR": 35, "FLIP": 0.2})]
    found = texture_points.losses([*ours, *beside, Point("C", "", 0.5, {"PSNR": 50})])
    assert [(loss.other.codec, loss.figure, loss.bits, loss.ours) for loss in found] == [
        ("A", "FLIP", 2, pytest.approx(0.1)),
        ("B", "PSNR", 4, pytest.approx(34)),
    ]
    assert texture_points.losses(beside) == []


def test_command(monkeypatch, folder, tmp_path):
    """All files, from a few of the maps and codecs."""
    for name in ("albedo", "roughness"):
        shutil.copy(folder / f"{name}.png", tmp_path)
    folder = tmp_path
    monkeypatch.setattr(texture_codecs, "check_installed", lambda: None)
    monkeypatch.setattr(texture_codecs, "all_coded", lambda maps: texture_peers.smaller(maps))
    monkeypatch.setitem(texture_points.recorded.RTXNTC, folder.name, [(0.5, 20.0)])
    metrics = texture_codecs.main(texture_codecs.Config(material=folder, out=tmp_path, device="cpu", json=True))
    assert metrics[f"{RTXNTC} 0.5 / 0.500 bits"] == 20.0 and len(metrics) == 5
    saved = json.loads((tmp_path / "codecs.json").read_text())
    assert [point["setting"] for point in saved["points"]] == ["half", "quarter", "eighth", "0.5"]
    page = (tmp_path / "codecs.md").read_text()
    assert "| smaller | half | 8.00 |" in page and "## Where we lose" in page
    for name in ("curves", "crops", "sphere"):
        assert load_image(tmp_path / f"{name}.png").std() > 0.05


def test_peers_that_are_missing(monkeypatch):
    monkeypatch.setattr(texture_peers, "find_spec", lambda name: name == "etcpak" or None)
    with pytest.raises(InputError, match=r"quicktex, texture2ddecoder: not installed; pip install"):
        texture_peers.check_installed()
