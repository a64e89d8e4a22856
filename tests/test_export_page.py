"""Exported pages in Chromium, where there is one: the pixels are Python's, and controls do what they say."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from engine_textures import MAPS, SPEC, make_state
from PIL import Image

import warp_neural as wn
from warp_neural.errors import InputError
from warp_neural.export import export
from warp_neural.export.textures import sampled
from warp_neural.imaging.image import linear_to_srgb, srgb_to_linear
from warp_neural.kernels.texture.spec import BlockSpec
from warp_neural.samples.deployment import browser
from warp_neural.samples.shader_training.spheres import Surface, render
from warp_neural.samples.shader_training.train import make_net
from warp_neural.texture.engine import EngineTexture
from warp_neural.texture.state import Map

CLOSE, SHARE = 2 / 255, 0.999  # of pixels so close
UNIT = (0.0,) * 3, (1.0,) * 3
MATERIAL = Map("albedo", "srgb", *UNIT), Map("normal", "normal", *UNIT), Map("roughness", "linear", (0.1,), (0.9,))


@pytest.fixture(scope="module")
def started():
    if lacking := browser.missing():
        pytest.skip(f"no {lacking}: pip install playwright, and .ci/tools says how to get chromium")
    with browser.browser() as found:
        yield found


def picture_net(encoding=None, precision="float32"):
    """Some results are below 0, some beyond 1."""
    encoding = encoding or wn.encodings.Frequency(3)
    net = wn.MLP(2, 3, 18, 2, encoding=encoding, precision=precision, device="cpu", seed=1)
    net.biases = [*net.biases[:-1], np.array([0.1, 0.5, 0.9])]
    return net


def picture_of(net, uv):
    rows = uv.reshape(-1, 2).astype(net.dtype if hasattr(net, "dtype") else np.float32)
    colors = linear_to_srgb(np.clip(net.evaluate(rows).numpy().astype(np.float32), 0, 1)).reshape(*uv.shape[:2], 3)
    inside = (uv == np.clip(uv, 0, 1)).all(-1)
    return np.where(inside[..., None], colors, 0.35 * colors)


def open_picture(started, folder, **options):
    net = picture_net()
    export(net, "html", folder)
    return net, browser.opened(started, folder / "network.html", **options)


def check(codes, expected):
    off = np.abs(codes / 255 - expected).max(-1)
    assert (off <= CLOSE).mean() >= SHARE, f"{(off <= CLOSE).mean()} of the pixels, off by {off.max()} at most"
    assert codes.std() > 5


@pytest.mark.parametrize(
    ("encoding", "precision"),
    [
        (None, "float32"),
        (None, "float16"),
        (wn.encodings.HashGrid(4, 2, 6, 3, 1.7, initial=(-1, 1)), "float32"),
        (wn.encodings.LatentTexture(5, 7, 6, wrap=True), "float32"),
    ],
)
def test_a_picture(started, tmp_path, encoding, precision):
    net = picture_net(encoding, precision)
    export(net, "html", tmp_path)
    page = browser.opened(started, tmp_path / "network.html")
    codes, uv = browser.pixels(page)
    assert codes.shape == (256, 256, 3)
    np.testing.assert_allclose([uv[0, 0], uv[-1, -1]], [[0.5 / 256] * 2, [255.5 / 256] * 2])
    check(codes, picture_of(net, uv))
    print("first picture after {:.0f} ms, a frame {:.1f} ms".format(*browser.milliseconds(page)))


def test_it_asks_for_nothing_and_says_nothing(started, tmp_path):
    said = []
    _net, page = open_picture(started, tmp_path, said=said)
    assert said == [(tmp_path / "network.html").as_uri()] and page.text_content("#problem") == ""
    size = (tmp_path / "network.html").stat().st_size
    assert f"{size:,} bytes" in page.text_content("dl") and "http" not in page.content()


def test_moving_about(started, tmp_path):
    """Dragging, the wheel, keys and buttons: where the page says that it is, and what Python has there."""
    net, page = open_picture(started, tmp_path)
    _codes, home = browser.pixels(page)
    step = home[0, 1] - home[0, 0]
    box = page.locator("#picture").bounding_box()
    x, y = box["x"] + 100, box["y"] + 60
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 50, y + 30, steps=3)
    page.mouse.up()
    codes, dragged = browser.pixels(page)
    np.testing.assert_allclose(dragged - home, np.broadcast_to([-50 * step[0], -30 * step[0]], home.shape), atol=1e-6)
    check(codes, picture_of(net, dragged))

    page.mouse.wheel(0, -300)
    codes, near = browser.pixels(page)
    np.testing.assert_allclose(near[90, 150], dragged[90, 150], atol=2e-3)  # what is under the pointer stays
    np.testing.assert_allclose(np.diff(near[0, :2, 0]) / step[0], np.exp(-0.45), rtol=1e-4)
    check(codes, picture_of(net, near))

    page.click("#again")
    np.testing.assert_array_equal(browser.pixels(page)[1], home)
    page.focus("#picture")
    for keys, expected in {"ArrowLeft": (-32, 0), "ArrowDown ArrowRight": (0, 32), "ArrowUp": (0, 0)}.items():
        for key in keys.split():
            page.keyboard.press(key)
        moved = (browser.pixels(page)[1] - home)[0, 0] / step[0]
        np.testing.assert_allclose(moved, expected, atol=1e-3)
    for act, scale in ((lambda: page.keyboard.press("+"), 0.8), (lambda: page.click("#farther"), 1)):
        act()
        np.testing.assert_allclose(np.diff(browser.pixels(page)[1][0, :2, 0]) / step[0], scale, rtol=1e-4)
    page.keyboard.press("0") if page.evaluate("document.activeElement.id") == "picture" else page.click("#again")
    np.testing.assert_array_equal(browser.pixels(page)[1], home)


def test_two_fingers(started, tmp_path):
    net, page = open_picture(started, tmp_path, has_touch=True)
    _codes, home = browser.pixels(page)
    box, session = page.locator("#picture").bounding_box(), page.context.new_cdp_session(page)
    middle = box["x"] + 128, box["y"] + 128
    for kind, apart in (("touchStart", 20), ("touchMove", 30), ("touchMove", 40), ("touchEnd", None)):
        points = [{"x": middle[0] + side * apart, "y": middle[1], "id": side} for side in (-1, 1)] if apart else []
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    codes, near = browser.pixels(page)
    np.testing.assert_allclose(np.diff(near[0, :2, 0]) / np.diff(home[0, :2, 0]), 0.5, rtol=1e-3)
    np.testing.assert_allclose(near[127:129, 127:129].mean((0, 1)), home[127:129, 127:129].mean((0, 1)), atol=1e-3)
    check(codes, picture_of(net, near))


def open_texture(started, folder, state, **options):
    EngineTexture(state, "cpu").save(folder / "stone.safetensors")
    export(folder / "stone.safetensors", "html", folder)
    return browser.opened(started, folder / "stone.html", **options)


def channels_at(state, uv, lod):
    rows = np.concatenate([uv.reshape(-1, 2), np.full((uv[..., 0].size, 1), lod)], 1).astype(np.float32)
    return sampled(state, rows).reshape(*uv.shape[:2], -1)


@pytest.mark.parametrize("script", ["", "WebGL2RenderingContext.prototype.getExtension = () => null"])
def test_a_texture(started, tmp_path, script):
    """Maps and mip levels, with the driver's BC1 and without."""
    state, said = make_state(), []
    page = open_texture(started, tmp_path, state, script=script, said=said)
    assert said == [(tmp_path / "stone.html").as_uri()] and page.text_content("#problem") == ""
    codes, uv = browser.pixels(page)
    assert codes.shape[:2] == (384, 256)
    check(codes, channels_at(state, uv, 0)[..., :3])
    page.locator("#farther").focus()
    for _ in range(12):
        page.keyboard.press("Enter")
    codes, uv = browser.pixels(page)
    wanted = np.log2((uv[0, 1, 0] - uv[0, 0, 0]) * SPEC.width)
    assert 0.3 < wanted < 0.4
    check(codes, channels_at(state, uv, wanted)[..., :3])
    page.select_option("#shown", label="height")
    for level in ("0", "2.3", "3"):
        page.fill("#level", level)
        codes, _uv = browser.pixels(page)
        height = channels_at(state, uv, float(level))[..., 3:]
        expected = (np.concatenate([height, np.full_like(height, 0.5), 0 * height], -1) + 2) / 7
        check(codes, expected)
    assert not page.is_checked("#automatic")


def lit(stored, azimuth=135, elevation=40):
    """What `texture.frag` says, in float64."""
    albedo, normal, roughness = srgb_to_linear(stored[..., :3]), 2 * stored[..., 3:6] - 1, stored[..., 6:7]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    a, e = np.radians([azimuth, elevation])
    light = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    half = light + np.array([0, 0, 1])
    half /= np.linalg.norm(half)
    nl, nh = ((normal @ each)[..., None].clip(0) for each in (light, half))
    nv = normal[..., 2:].clip(0.05)
    alpha = (roughness**2).clip(0.02)
    k, d = alpha / 2, nh**2 * (alpha**2 - 1) + 1
    fresnel = 0.04 + 0.96 * (1 - light @ half) ** 5
    specular = fresnel * alpha**2 / (np.pi * d**2) / (4 * (nl * (1 - k) + k) * (nv * (1 - k) + k))
    return linear_to_srgb((4 * (albedo / np.pi + specular) * nl + 0.12 * albedo).clip(0, 1))


def test_a_lit_material(started, tmp_path):
    state = make_state(BlockSpec(32, 32, 7, 3, (1, 2), (32, 32)), maps=MATERIAL)
    page = open_texture(started, tmp_path, state)
    codes, uv = browser.pixels(page)
    check(codes, lit(channels_at(state, uv, 0)))
    page.fill("#azimuth", "-60")
    page.fill("#elevation", "20")
    codes, _uv = browser.pixels(page)
    check(codes, lit(channels_at(state, uv, 0), -60, 20))
    page.select_option("#shown", label="roughness")
    codes, _uv = browser.pixels(page)
    check(codes, channels_at(state, uv, 0)[..., [6, 6, 6]])
    page.fill("#level", "1")
    page.fill("#tilt", "0.9")
    codes, _uv = browser.pixels(page)
    depth = 1 - 0.9 * (127.5 - np.arange(256)) / 256
    tilted = 0.5 + (uv - 0.5) / depth[:, None, None]
    check(codes, channels_at(state, tilted, 1)[..., [6, 6, 6]])


def test_a_sphere(started, tmp_path):
    """Against the sample's own, and turned."""
    net = make_net("cpu", seed=2)
    net.biases = [*net.biases[:-1], np.array([-1.0, -0.5, -1.0, -2.0])]
    export(net, "html", tmp_path)
    page = browser.opened(started, tmp_path / "network.html")
    checked, _uv = browser.pixels(page)
    page.uncheck("#checks")
    surface = Surface()
    hexadecimal = page.input_value("#base_color")
    codes = np.array([int(hexadecimal[i : i + 2], 16) for i in (1, 3, 5)])
    surface.base_color, surface.specular = wp.vec3(*srgb_to_linear(codes / 255)), 0.5
    names = "metallic", "intensity", "roughness", "azimuth", "elevation"
    for values in ((0.2, 3, 0.35, 45, 35), (0.9, 2, 0.7, -120, -10)):
        for name, value in zip(names, values, strict=True):
            page.fill(f"#{name}", str(value))
        surface.metallic, surface.intensity, roughness, azimuth, elevation = values
        a, e = np.radians([azimuth, elevation])
        light = np.array([[np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]])
        codes, _uv = browser.pixels(page)
        check(codes, render(net, surface, np.array([roughness]), light, 256)[1, 0])
    page.click("#again")
    page.focus("#picture")
    page.keyboard.press("ArrowRight")
    turned, _uv = browser.pixels(page)
    unlike = (turned != checked).any(-1)
    assert 0.02 < unlike.mean() < 0.5 and (turned.any(-1) == checked.any(-1)).all()  # the light has not moved


def test_problems_are_said(started, tmp_path):
    export(picture_net(), "html", tmp_path)
    text = (tmp_path / "network.html").read_text()
    assert text.count("void main() {\\n    vec2 uv") == 1
    (tmp_path / "wrong.html").write_text(text.replace("void main() {\\n    vec2 uv", "void main() {\\n    vec2 uw"))
    page = started.new_page()
    page.goto((tmp_path / "wrong.html").as_uri())
    assert "driver refuses the shader: ERROR" in page.text_content("#problem")
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.goto((tmp_path / "network.html").as_uri())
    assert "no WebGL2" in page.text_content("#problem") and page.is_visible("#problem")


def test_saving_a_picture(started, tmp_path):
    _net, page = open_picture(started, tmp_path)
    codes, _uv = browser.pixels(page)
    with page.expect_download() as saved:
        page.click("#save")
    assert saved.value.suggested_filename == "network.png"
    np.testing.assert_array_equal(np.asarray(Image.open(saved.value.path()).convert("RGB")), codes)


def test_networks_of_other_formats(tmp_path):
    """Their weights as float16, as the other targets have them."""
    for precision in ("e5m2", "int8"):
        net = wn.MLP(2, 3, 16, 1, precision=precision, device="cpu")
        made = export(net, "html", tmp_path / precision, precision="float16")
        assert made["precision"] == "float16" and "float16" in (tmp_path / precision / "README.md").read_text()


def test_what_pages_cannot_show(tmp_path):
    for net, message in (
        (wn.MLP(3, 3, 8, 1, device="cpu"), "3 inputs and 3 results: pages show pictures .2 inputs"),
        (wn.MLP(2, 4, 8, 1, device="cpu"), "2 inputs and 4 results: .* give target wgsl"),
        (wn.MLP(2, 3, 144, 1, device="cpu"), "a layer of 144: pages have layers of up to 128"),
    ):
        with pytest.raises(InputError, match=message):
            export(net, "html", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_names_of_maps_are_text(tmp_path):
    maps = replace(MAPS[0], name="</script><b>&@DATA@"), MAPS[1]
    EngineTexture(replace(make_state(), maps=maps), "cpu").save(tmp_path / "stone.safetensors")
    export(tmp_path / "stone.safetensors", "html", tmp_path / "out")
    text = (tmp_path / "out" / "stone.html").read_text()
    assert text.count("</script>") == 2 and "<b>" not in text
    assert '<option value="0">&lt;/script&gt;&lt;b&gt;&amp;@DATA@</option>' in text
