"""Exported pages in Chromium, where there is one: the pixels are Python's, and controls do what they say."""

import numpy as np
import pytest
from engine_textures import make_state

import warp_neural as wn
from warp_neural.export import export
from warp_neural.export.textures import sampled
from warp_neural.imaging.image import linear_to_srgb
from warp_neural.samples.deployment import browser
from warp_neural.texture.engine import EngineTexture

CLOSE, SHARE = 2 / 255, 0.999  # of pixels so close


@pytest.fixture(scope="module")
def started():
    if lacking := browser.missing():
        pytest.skip(f"no {lacking}: pip install playwright, and .ci/tools says how to get chromium")
    with browser.browser() as found:
        yield found


def share_close(codes, expected) -> float:
    return float((np.abs(codes / 255 - expected).max(-1) <= CLOSE).mean())


def test_a_picture(started, tmp_path):
    net = wn.MLP(2, 3, 32, 2, encoding=wn.encodings.Frequency(4), output_activation=wn.activations.sigmoid, device="cpu")
    export(net, "html", tmp_path)
    page = browser.opened(started, tmp_path / "network.html")
    codes, uv = browser.pixels(page)
    expected = linear_to_srgb(net.evaluate(uv.reshape(-1, 2).astype(np.float32)).numpy()).reshape(codes.shape)
    print(codes.shape, uv[0,0], uv[-1,-1], browser.milliseconds(page), share_close(codes, expected), np.abs(codes/255-expected).max())
    assert share_close(codes, expected) >= SHARE and codes.std() > 5


def test_a_texture(started, tmp_path):
    state = make_state()
    EngineTexture(state, "cpu").save(tmp_path / "stone.safetensors")
    export(tmp_path / "stone.safetensors", "html", tmp_path)
    page = browser.opened(started, tmp_path / "stone.html")
    for lod in (None, 0, 1.3, 3):
        if lod is not None:
            page.locator("#level").fill(str(lod))
        codes, uv = browser.pixels(page)
        wanted = lod if lod is not None else max(np.log2(48 / codes.shape[1]), 0)
        rows = np.concatenate([uv.reshape(-1, 2), np.full((codes[..., 0].size, 1), wanted)], 1).astype(np.float32)
        expected = sampled(state, rows)[:, :3].reshape(codes.shape)
        print(lod, codes.shape, share_close(codes, expected), np.abs(codes/255-expected).max(), codes.std())
