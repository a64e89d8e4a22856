"""Pages of textures and spheres in Chromium, where there is one, against Python."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from engine_textures import MAPS, SPEC, make_state
from pages import check

from warp_neural.export import export
from warp_neural.export.textures import sampled
from warp_neural.imaging.image import linear_to_srgb, srgb_to_linear
from warp_neural.kernels.texture.spec import BlockSpec
from warp_neural.samples.deployment import browser
from warp_neural.samples.shader_training.spheres import Surface, render
from warp_neural.samples.shader_training.train import make_net
from warp_neural.texture.engine import EngineTexture
from warp_neural.texture.state import Map

UNIT = (0.0,) * 3, (1.0,) * 3
MATERIAL = Map("albedo", "srgb", *UNIT), Map("normal", "normal", *UNIT), Map("roughness", "linear", (0.1,), (0.9,))


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


def test_maps_of_light_and_of_many_channels(started, tmp_path):
    maps = Map("sky", "hdr", (-4.0,), (3.0,)), Map("masks", "linear", (0.0,) * 4, (1.0,) * 4)
    state = make_state(BlockSpec(32, 32, 5, 1, (2, 4), (16,)), maps=maps)
    page = open_texture(started, tmp_path, state)
    codes, uv = browser.pixels(page)
    stored = channels_at(state, uv, 0)
    check(codes, linear_to_srgb(stored / (1 + stored))[..., [0, 0, 0]])
    assert page.locator("#shown option").all_text_contents() == ["sky", "masks, channels 0 to 2", "masks, channel 3"]
    for label, channels in (("masks, channels 0 to 2", [1, 2, 3]), ("masks, channel 3", [4, 4, 4])):
        page.select_option("#shown", label=label)
        check(browser.pixels(page)[0], stored[..., channels])


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
    v, u = np.indices((256, 256)) - 127.5
    outside, behind = np.hypot(u, v)[..., None] > 256 / 2.2, np.array([0.17, 0.18, 0.2])
    for values in ((0.2, 3, 0.35, 45, 35), (0.9, 2, 0.7, -120, -10)):
        for name, value in zip(names, values, strict=True):
            page.fill(f"#{name}", str(value))
        surface.metallic, surface.intensity, roughness, azimuth, elevation = values
        a, e = np.radians([azimuth, elevation])
        light = np.array([[np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]])
        codes, _uv = browser.pixels(page)
        check(codes, np.where(outside, behind, render(net, surface, np.array([roughness]), light, 256)[1, 0]))
    page.click("#again")
    page.focus("#picture")
    page.keyboard.press("ArrowRight")
    turned, _uv = browser.pixels(page)
    unlike = (turned != checked).any(-1)
    assert 0.02 < unlike.mean() < 0.5 and (turned.any(-1) == checked.any(-1)).all()  # the light has not moved


def test_the_names_of_maps_are_text(tmp_path):
    maps = replace(MAPS[0], name="</script><b>&@DATA@"), MAPS[1]
    EngineTexture(replace(make_state(), maps=maps), "cpu").save(tmp_path / "stone.safetensors")
    export(tmp_path / "stone.safetensors", "html", tmp_path / "out")
    text = (tmp_path / "out" / "stone.html").read_text()
    assert text.count("</script>") == 2 and "<b>" not in text
    assert '<option value="0">&lt;/script&gt;&lt;b&gt;&amp;@DATA@</option>' in text
