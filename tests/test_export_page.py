"""Exported pages in Chromium, where there is one: the pixels are Python's, and controls do what they say."""

import numpy as np
import pytest
from pages import check
from PIL import Image

import warp_neural as wn
from warp_neural.errors import InputError
from warp_neural.export import export
from warp_neural.export.program import evaluated, network_of
from warp_neural.imaging.image import linear_to_srgb
from warp_neural.samples.deployment import browser


def picture_net(encoding=None, precision="float32"):
    """Some results are below 0, some beyond 1."""
    encoding = encoding or wn.encodings.Frequency(3)
    net = wn.MLP(2, 3, 18, 2, encoding=encoding, precision=precision, device="cpu", seed=1)
    net.biases = [*net.biases[:-1], np.array([0.1, 0.5, 0.9])]
    return net


def picture_of(net, uv):
    _inputs, linear = evaluated(network_of(net.state, None), uv.reshape(-1, 2).astype(np.float32))
    colors = linear_to_srgb(np.clip(linear, 0, 1)).reshape(*uv.shape[:2], 3)
    inside = (uv == np.clip(uv, 0, 1)).all(-1)
    return np.where(inside[..., None], colors, 0.35 * colors)


def open_picture(started, folder, **options):
    net = picture_net()
    export(net, "html", folder)
    return net, browser.opened(started, folder / "network.html", **options)


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


def wait_for_step(page, step):
    """Until pixels are so far apart: wheels and fingers are heard later."""
    reached = "step => Math.abs(picture.dataset.view.split(' ')[2] / step - 1) < 1e-3"
    page.wait_for_function(reached, arg=float(step))


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
    wait_for_step(page, np.exp(-0.45) / 256)
    codes, near = browser.pixels(page)
    np.testing.assert_allclose(near[90, 150], dragged[90, 150], atol=2e-3)  # what is under the pointer stays
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
    page.focus("#picture")
    for key in ("ArrowUp", "-", "0"):
        page.keyboard.press(key)
    np.testing.assert_array_equal(browser.pixels(page)[1], home)


def test_two_fingers(started, tmp_path):
    net, page = open_picture(started, tmp_path, has_touch=True)
    _codes, home = browser.pixels(page)
    box, session = page.locator("#picture").bounding_box(), page.context.new_cdp_session(page)
    middle = box["x"] + 128, box["y"] + 128
    for kind, apart in (("touchStart", 20), ("touchMove", 30), ("touchMove", 40), ("touchEnd", None)):
        points = [{"x": middle[0] + side * apart, "y": middle[1], "id": side} for side in (-1, 1)] if apart else []
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    wait_for_step(page, 0.5 / 256)
    codes, near = browser.pixels(page)
    np.testing.assert_allclose(near[127:129, 127:129].mean((0, 1)), home[127:129, 127:129].mean((0, 1)), atol=1e-3)
    check(codes, picture_of(net, near))


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
        (wn.MLP(2, 3, 144, 1, device="cpu"), "a layer of 144: as constants they have up to 128"),
    ):
        with pytest.raises(InputError, match=message):
            export(net, "html", tmp_path / "out")
    assert not (tmp_path / "out").exists()
