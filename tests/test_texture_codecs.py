"""`perf.texture_codecs` at toy size: sizes by hand, the choice of qualities, the sphere, and where we lose."""

import json
import shutil

import numpy as np
import pytest
import warp as wp

from perf import texture_codecs, texture_peers, texture_pictures, texture_points, texture_rivals, texture_sphere
from perf.results import load_all
from perf.texture_peers import BLOCKS, Coded
from perf.texture_points import OURS, RTXNTC, Judge, Point
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image, save_exr, save_image
from warp_neural.materials.default_material import default_material
from warp_neural.materials.material import save_material
from warp_neural.texture import compression
from warp_neural.texture.maps import load_set
from warp_neural.texture.presets import Effort
from warp_neural.texture.state import Map

PEERS = ("etcpak", "quicktex", "texture2ddecoder")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("material")
    save_material(folder, default_material(64))
    return folder


@pytest.fixture(scope="module")
def material(folder):
    return texture_points.load_material(folder, None)


@pytest.fixture(scope="module")
def maps(material):
    return texture_points.original_codes(material)


def test_maps_are_as_stored(folder, maps):
    assert list(maps) == ["albedo", "normal", "roughness", "metalness", "ao", "height", "opacity"]
    expected = load_image(folder / "roughness.png", color_space="linear") * 255
    assert np.abs(maps["roughness"] - expected).max() <= 0.501 and maps["albedo"].shape == (64, 64, 3)
    cut = texture_points.original_codes(texture_points.load_material(folder, 20))
    assert cut["normal"].shape == (20, 20, 3) and (cut["ao"] == maps["ao"][22:42, 22:42]).all()


def test_alpha_is_a_map_of_its_own():
    stored = {"decal": np.full((2, 3, 4), (0, 0.5, 1, 0.2), np.float32), "a": np.ones((2, 3, 2), np.float32)}
    described = [Map("decal", "srgb", (0.0,) * 4, (1.0,) * 4), Map("a", "linear", (0.0,) * 2, (1.0,) * 2)]
    codes = texture_points.codes_of(stored, described)
    channels = {name: pixels.shape[2] for name, pixels in codes.items()}
    assert channels == {"decal": 3, "decal alpha": 1, "a": 1, "a alpha": 1}
    assert codes["decal"][0, 0].tolist() == [0, 128, 255] and (codes["decal alpha"] == 51).all()


def test_hdr_is_compared_as_logarithms(tmp_path):
    """Half a code of the logarithms is what 8 bits lose; a map that is 10 % too bright is wrong by that."""
    values = np.geomspace(0.01, 100, 64 * 64, dtype=np.float32).reshape(64, 64)
    save_exr(tmp_path / "sky.exr", {channel: values for channel in "RGB"})
    texture_set = texture_points.load_material(tmp_path / "sky.exr", None)
    assert [each.kind for each in texture_set.maps] == ["hdr"]
    judge = Judge(texture_set, wp.get_device("cpu"))
    name, each = texture_set.maps[0].name, texture_set.maps[0]
    linear = texture_points.light(texture_points.displayed(judge.maps[name]), each)
    dark = 2.0 ** min(each.low)
    code = np.log(2) * (max(each.high) - min(each.low)) / 255
    assert 0.2 * code < np.abs((linear[..., 0] - values) / (values + dark)).max() < 0.51 * code
    brighter = texture_points.codes_of({name: np.float32(1.1 * linear + 0.1 * dark)}, texture_set.maps)
    figures = judge.point(Coded("a", "", 512, brighter)).figures
    assert figures[f"{name} relative error"] == pytest.approx(0.1, abs=code / 2) and "sphere FLIP" not in figures


def test_block_formats(maps):
    for name in PEERS:
        pytest.importorskip(name)
    original = {name: maps[name][:62, :61] / np.float32(255) for name in ("albedo", "normal", "roughness", "ao")}
    material = load_set(original)
    maps = texture_points.original_codes(material)  # 16 x 16 blocks
    coded = {each.setting: each for each in texture_peers.block_formats(maps)}
    sizes = {"BC1": 3 * 8, "BC1, BC4": 4 * 8, "BC1, BC5, BC4": 2 * 8 + 16 + 8}
    sizes |= {"BC7": 3 * 16, "BC7, BC4": 2 * 16 + 16, "BC7, BC5, BC4": 2 * 16 + 16}
    assert {setting: each.size for setting, each in coded.items()} == {k: 256 * v for k, v in sizes.items()}
    judge = Judge(material, wp.get_device("cpu"))
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


def test_judge(material, maps):
    judge = Judge(material, wp.get_device("cpu"))
    same = judge.point(Coded("a", "", 512, maps))
    assert same.bits == 1 and same.figures["PSNR"] == 120 and same.figures["ao SSIM"] == 1
    assert same.figures["albedo FLIP"] == same.figures["sphere FLIP"] == 0
    off = maps | {"roughness": np.where(maps["roughness"] > 127, maps["roughness"] - 10, maps["roughness"] + 10)}
    point = judge.point(Coded("b", "", 512, off))
    channels = sum(pixels.shape[2] for pixels in maps.values())
    assert point.figures["PSNR"] == pytest.approx(10 * np.log10(255**2 / (100 / channels)))
    assert point.figures["roughness PSNR"] == pytest.approx(10 * np.log10(255**2 / 100))
    assert point.figures["sphere FLIP"] > 0.001 and point.figures["albedo FLIP"] == 0
    flat = maps | {"normal": np.full_like(maps["normal"], 128) + np.uint8((0, 0, 127))}
    tilt = np.degrees(np.arccos(np.clip(2.0 * maps["normal"][..., 2] / 255 - 1, -1, 1))).mean()
    assert judge.point(Coded("c", "", 512, flat)).figures["normal degrees"] == pytest.approx(tilt, abs=0.5)


def test_sphere_is_lit_by_its_normals():
    """Flat maps: brightest where the sphere faces the light, black beside it; a bent normal moves the brightness."""
    flat = {"normal": np.full((64, 64, 3), (128, 128, 255), np.uint8), "ao": np.full((64, 64, 1), 255, np.uint8)}
    picture = texture_sphere.render(flat, wp.get_device("cpu")).sum(-1)
    i, j = np.unravel_index(picture.argmax(), picture.shape)
    light = np.array(texture_sphere.LIGHT) / np.linalg.norm(texture_sphere.LIGHT)
    half = light + np.array([0, 0, 1])
    half /= np.linalg.norm(half)
    assert np.hypot(32 + 32 * half[0] - j, 32 - 32 * half[1] - i) < 12 and picture[0, 0] == 0
    down = {"normal_dx": flat["normal"] * np.uint8((1, 0, 1)) + np.uint8((0, 127, 0)), "ao": flat["ao"]}
    np.testing.assert_allclose(
        texture_sphere.render(down, wp.get_device("cpu")).sum(-1), picture, atol=1e-4
    )  # rounding
    right = flat | {"normal": np.full((64, 64, 3), (200, 128, 230), np.uint8)}
    bent = texture_sphere.render(right, wp.get_device("cpu")).sum(-1)
    assert (bent * np.arange(64)).sum() / bent.sum() < (picture * np.arange(64)).sum() / picture.sum() - 2


def test_where_we_lose():
    """At our bits, between the other's files; block formats at their own, or beside our largest file."""
    ours = [Point(OURS, "", bits, {"PSNR": psnr, "FLIP": 0.1}) for bits, psnr in ((1, 30), (4, 34))]
    curve = [Point("A", "", bits, {"PSNR": psnr, "FLIP": 0.09}) for bits, psnr in ((0.5, 29.5), (2, 30.7), (8, 35.3))]
    blocks = [Point(BLOCKS, "B", 2, {"PSNR": 31.9}), Point(BLOCKS, "C", 8, {"PSNR": 36, "FLIP": 0.2})]
    below = [Point("D", "", bits, {"PSNR": 50}) for bits in (0.1, 0.5)]
    found = texture_rivals.rivals([*ours, *curve, *blocks, *below])
    lost = [(r.codec, r.measure, r.bits, r.its_bits, pytest.approx(r.behind)) for r in texture_rivals.losses(found)]
    assert lost == [
        ("A", "FLIP", 1, 1, 0.01),
        ("A", "FLIP", 4, 4, 0.01),
        ("A", "PSNR", 1, 1, 0.1),
        ("C", "PSNR", 4, 8, 2),
    ]
    best = texture_rivals.best_at_equal_bits([r for r in found if r.codec == "A"])
    assert [(r.codec, r.bits, r.its) for r in best["PSNR"]] == [
        ("A", 1, pytest.approx(30.1)),
        ("A", 4, pytest.approx(33)),
    ]
    assert texture_rivals.rivals(curve) == []


def test_lines_reach_as_far_as_sizes_are_met():
    line = [Point(RTXNTC, "", bits, {"PSNR": psnr}) for bits, psnr in ((1.0, 30.0), (2.0, 31.0), (4.0, 33.0))]
    assert texture_rivals.between(line, "PSNR", 4.1) == pytest.approx(33 + 2 * np.log2(4.1 / 4))
    assert texture_rivals.between(line, "PSNR", 0.98) == pytest.approx(30 + np.log2(0.98))
    assert texture_rivals.between(line, "PSNR", 4.2) is None and texture_rivals.between(line, "SSIM", 2) is None


def test_side_by_side():
    """The nearest files to 1, 2 and 4 bits, none that is far from them, ours before AVIF."""
    sizes = {OURS: (0.9, 1.3, 3.9), "AVIF": (1.1, 1.9)}
    coded = [(Coded(codec, "", 0, {}), Point(codec, "", bits)) for codec, some in sizes.items() for bits in some]
    chosen = texture_pictures.side_by_side(coded)
    assert [(point.codec, point.bits) for _, point in chosen] == [
        (OURS, 0.9), ("AVIF", 1.1), ("AVIF", 1.9), (OURS, 3.9),
    ]  # fmt: skip


@pytest.fixture
def few(monkeypatch, folder, tmp_path):
    """Two of the maps, few other codecs, short training."""
    material = tmp_path / "some"
    material.mkdir()
    shutil.copy(folder / "albedo.png", material)
    save_image(material / "roughness.png", np.full((64, 64, 1), 0.25), color_space="linear")
    monkeypatch.setattr(texture_codecs, "check_installed", lambda: None)
    monkeypatch.setattr(texture_codecs, "all_coded", lambda maps: texture_peers.smaller(maps))
    monkeypatch.setattr(compression, "effort_of", lambda device, preview, texels: Effort(40, 1))
    monkeypatch.setattr(
        texture_codecs,
        "compress",
        lambda texture_set, bpp, preview, **options: compression.compress(texture_set, quality="low", **options),
    )
    monkeypatch.setitem(texture_points.recorded.RTXNTC, "some", [(8.0, 20.0), (20.0, 10.0)])
    return {"material": material, "sheets": tmp_path / "sheets", "out": tmp_path / "out", "device": "cpu", "json": True}


def test_command(few, tmp_path):
    """All that is written, with a file that is made and then given."""
    metrics = texture_codecs.main(texture_codecs.CodecsConfig(bpp=(14.0,), **few))
    sheets, made = tmp_path / "sheets" / "some", tmp_path / "sheets" / "some" / "14.wntc"
    saved = json.loads((sheets / "codecs.json").read_text())
    assert [p["setting"] for p in saved["points"]] == ["14.wntc", "half", "quarter", "eighth", "8.0", "20.0"]
    ours = saved["points"][0]
    assert ours["bits"] == 8 * made.stat().st_size / 64**2 and ours["figures"]["roughness PSNR"] == 120
    line = 20 - 10 * np.log(ours["bits"] / 8) / np.log(20 / 8)
    result = load_all(tmp_path / "out")["texture_codecs_some"]
    assert result.find("ahead: PSNR", "least of RTXNTC (recorded)").value == pytest.approx(
        ours["figures"]["PSNR"] - line
    )
    page = (sheets / "codecs.md").read_text()
    assert "| smaller | half | 8.00 |" in page and "## Where we lose" in page and metrics["losses"] >= 0
    pictures = [sheets / "crops.png", sheets / "sphere.png", tmp_path / "out" / "texture_codecs_some.png"]
    assert all(load_image(path).std() > 0.05 for path in pictures)
    again = texture_codecs.CodecsConfig(files=(made,), made_on="a card", **few)
    assert texture_codecs.main(again) == metrics
    assert "Our files were made on a card." in (sheets / "codecs.md").read_text()


def test_files_of_other_pictures(few, tmp_path):
    config = texture_codecs.CodecsConfig(bpp=(14.0,), **few)
    texture_set, cpu = texture_points.load_material(config.material, None), wp.get_device("cpu")
    (path,) = texture_codecs.made(config, texture_set, cpu, tmp_path)
    for name, pixels in (("albedo", np.zeros((64, 64, 3))), ("albedo", np.zeros((32, 64, 3)))):
        save_image(config.material / f"{name}.png", pixels + np.linspace(0, 1, 64)[:, None], color_space="linear")
        save_image(config.material / "roughness.png", np.full((*pixels.shape[:2], 1), 0.25), color_space="linear")
        given = texture_codecs.CodecsConfig(files=(path,), **few)
        with pytest.raises(InputError, match=r"14.wntc: not a file of some; compress it again"):
            texture_codecs.ours(given, texture_points.load_material(config.material, None), cpu, tmp_path)


def test_peers_that_are_missing(monkeypatch):
    monkeypatch.setattr(texture_peers, "find_spec", lambda name: name == "etcpak" or None)
    with pytest.raises(InputError, match=r"quicktex, texture2ddecoder: not installed; pip install"):
        texture_peers.check_installed()
