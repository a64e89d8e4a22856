"""A material of maps as a set: its mip levels, its normals, its draws; the command that shows it."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from command_line import refused, run
from scipy.stats import chisquare

from warp_neural.imaging.image import load_image
from warp_neural.kernels.nn.random import stream, uniform
from warp_neural.kernels.render.textured import surface_at, textured_density, textured_evaluate, textured_sample
from warp_neural.materials.default_material import default_material
from warp_neural.materials.material import save_material
from warp_neural.render import Textured
from warp_neural.render.textured import mip_levels, widened

N = 300_000
BINS = 12, 16  # of the cosine, and of turns about the normal
VIEW = wp.constant(wp.vec3(0.6, 0.0, 0.8))


@wp.kernel(module="unique", enable_backward=False)
def draw_kernel(params: Textured.Params, lod: float, lights: wp.array[wp.vec3], weights: wp.array[wp.vec3]):
    i = wp.tid()
    u = uniform(stream(wp.uint64(1), 0, i), 0)
    uv = wp.vec2(0.3, 0.7)
    light = textured_sample(params, 0, uv, lod, VIEW, wp.vec3(u[0], u[1], u[2]))
    lights[i] = light
    if light[2] > 0.0:
        density = textured_density(params, 0, uv, lod, light, VIEW)
        weights[i] = textured_evaluate(params, 0, uv, lod, light, VIEW) / density


@wp.kernel(module="unique", enable_backward=False)
def look_kernel(
    params: Textured.Params,
    lod: float,
    lights: wp.array[wp.vec3],
    densities: wp.array[float],
    colors: wp.array[wp.vec3],
):
    i = wp.tid()
    densities[i] = textured_density(params, 0, wp.vec2(0.3, 0.7), lod, lights[i], VIEW)
    colors[i] = textured_evaluate(params, 0, wp.vec2(0.3, 0.7), lod, lights[i], VIEW)


@wp.kernel(module="unique", enable_backward=False)
def surface_kernel(params: Textured.Params, uvs: wp.array[wp.vec2], lod: float, normals: wp.array[wp.vec3]):
    i = wp.tid()
    normals[i] = surface_at(params, uvs[i], lod, wp.vec3(0.0, 0.0, 1.0)).normal


def hemisphere(fine: int) -> tuple[np.ndarray, float]:
    """Directions evenly over z > 0, `fine`^2 in each bin; the solid angle of each."""
    z = (np.arange(BINS[0] * fine) + 0.5) / (BINS[0] * fine)
    phi = 2 * np.pi * (np.arange(BINS[1] * fine) + 0.5) / (BINS[1] * fine)
    z, phi = np.meshgrid(z, phi, indexing="ij")
    sine = np.sqrt(1 - z * z)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=-1).reshape(-1, 3), 2 * np.pi / z.size


@pytest.mark.parametrize("lod", [0.0, 2.5, 9.0])
def test_draws_follow_the_density(lod, device):
    """And the mean of f cos / density is the integral of f cos, whatever is drawn below the surface."""
    params = Textured(default_material(64), device=device).params
    lights, weights = (wp.zeros(N, dtype=wp.vec3, device=device) for _ in range(2))
    wp.launch(draw_kernel, N, [params, lod, lights, weights], device=device)
    fine = 24
    directions, angle = hemisphere(fine)
    densities = wp.zeros(len(directions), dtype=float, device=device)
    colors = wp.zeros(len(directions), dtype=wp.vec3, device=device)
    inputs = [params, lod, wp.array(directions, dtype=wp.vec3, device=device), densities, colors]
    wp.launch(look_kernel, len(directions), inputs, device=device)
    parts = densities.numpy().astype(np.float64).reshape(BINS[0], fine, BINS[1], fine).sum(axis=(1, 3)) * angle
    drawn = lights.numpy()
    drawn = drawn[drawn[:, 2] > 0]
    phi = np.arctan2(drawn[:, 1], drawn[:, 0]) % (2 * np.pi)
    counts, _, _ = np.histogram2d(drawn[:, 2], phi, bins=BINS, range=[[0, 1], [0, 2 * np.pi]])
    observed, expected = np.append(counts, N - counts.sum()), N * np.append(parts, 1 - parts.sum())
    enough = expected > 10
    observed, expected = np.append(observed[enough], observed[~enough].sum()), expected[enough]
    expected = np.append(expected, N - expected.sum())
    kept = expected > 10
    assert kept.sum() > 150
    assert chisquare(observed[kept], expected[kept] * observed[kept].sum() / expected[kept].sum()).pvalue > 1e-3
    integral = colors.numpy().astype(np.float64).sum(axis=0) * angle
    error = weights.numpy().std(axis=0) / np.sqrt(N)
    assert (np.abs(weights.numpy().mean(axis=0) - integral) < 4 * error + 1e-3 * integral).all()
    assert (integral < 1).all() and (integral > 0.01).all()


def test_normals_turn_to_the_frame_of_texture_coordinates(device):
    """Maps have y up the picture, as frames do."""
    material = default_material(16)
    normal = np.broadcast_to(np.float32([0.48, 0.6, 0.64]), (16, 16, 3))
    params = Textured(replace(material, normal=normal), device=device).params
    uvs = wp.array(np.random.default_rng(0).uniform(-3, 3, (50, 2)), dtype=wp.vec2, device=device)
    normals = wp.zeros(50, dtype=wp.vec3, device=device)
    for lod in (-5.0, 0.0, 1.7, 100.0):
        wp.launch(surface_kernel, 50, [params, uvs, lod, normals], device=device)
        np.testing.assert_allclose(normals.numpy(), np.tile([0.48, 0.6, 0.64], (50, 1)), atol=1e-6)


def test_mip_levels_are_means_and_rougher():
    material = default_material(48)
    levels = mip_levels(material)
    assert [level.shape[0] for level in levels] == [48, 24, 12, 6, 3, 2, 1]
    np.testing.assert_allclose(levels[0][..., 6], material.roughness, atol=1e-6)
    np.testing.assert_allclose(levels[2][..., :3].mean(axis=(0, 1)), material.albedo.mean(axis=(0, 1)), rtol=1e-5)
    means = [float(level[..., 6].mean()) for level in levels]
    assert (np.diff(means[:4]) > 0).all() and means[3] < 1


def test_toksvigs_factor():
    """Of a mirror over facets whose mean normal has length 0.9: a power of 0.9 / (1 - 0.9), nearly."""
    alpha2 = widened(np.array([0.02]), np.array([0.9])) ** 4
    np.testing.assert_allclose(2 / alpha2 - 2, 9, rtol=1e-4)
    assert widened(np.array([0.3]), np.array([1.0])) == 0.3


def test_the_command_renders_a_folder(capfd, tmp_path):
    save_material(tmp_path / "material", default_material(32))
    options = "--size", "24x16", "--samples", "2", "--device", "cpu", "--features"
    found = run(capfd, "render", str(tmp_path / "material"), "-o", str(tmp_path / "a.exr"), *options)
    assert found["samples"] == 2 and found["dropped"] == 0 and found["seconds"] > 0
    first = load_image(tmp_path / "a.exr")
    assert first.shape == (16, 24, 3) and first.min() >= 0 and first.std() > 0.01
    assert load_image(tmp_path / "normal.exr").shape == load_image(tmp_path / "albedo.exr").shape == (16, 24, 3)
    run(capfd, "render", str(tmp_path / "material"), "-o", str(tmp_path / "b.exr"), *options)
    assert np.array_equal(load_image(tmp_path / "b.exr"), first)
    run(capfd, "render", "default", "-o", str(tmp_path / "c.png"), "--scene", "sphere", *options[:-1])
    assert load_image(tmp_path / "c.png").shape == (16, 24, 3)


def test_the_command_renders_layers(capfd, tmp_path):
    """The deluxe material, and a document's, red."""
    options = "--size", "24x16", "--samples", "4", "--scene", "sphere", "--device", "cpu"
    run(capfd, "render", "deluxe", "-o", str(tmp_path / "deluxe.exr"), *options)
    assert load_image(tmp_path / "deluxe.exr").std() > 0.01
    pytest.importorskip("MaterialX", reason="MaterialX is not installed")
    (tmp_path / "red.mtlx").write_text("""<?xml version="1.0"?>
<materialx version="1.39">
  <open_pbr_surface name="surface" type="surfaceshader">
    <input name="base_color" type="color3" value="0.8, 0.0, 0.0"/>
  </open_pbr_surface>
  <surfacematerial name="red" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="surface"/>
  </surfacematerial>
</materialx>""")
    run(capfd, "render", str(tmp_path / "red.mtlx"), "-o", str(tmp_path / "red.exr"), *options, "--features")
    red, _green, blue = load_image(tmp_path / "albedo.exr")[8, 12]
    assert red > 0.5 > 0.2 > blue


def test_the_command_renders_a_file_in_an_environment(capfd, tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    trimesh.creation.icosphere(radius=40).apply_translation((100, 7, 0)).export(tmp_path / "ball.ply")
    light = str(tmp_path / "light.exr")
    run(capfd, "render", "default", "-o", light, "--size", "16x8", "--samples", "1", "--device", "cpu")
    options = "--scene", str(tmp_path / "ball.ply"), "--light", light, "--rotation", "40", "--time", "1e-3"
    out = str(tmp_path / "d.png")
    found = run(capfd, "render", "default", "-o", out, *options, "--size", "24x16", "--samples", "9000")
    assert found["samples"] < 9000
    assert load_image(tmp_path / "d.png")[8, 12].max() > 0.01  # it is brought to the middle


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["default", "--size", "largest"], "width and height"),
        (["default", "--size", "0x10"], "width=0"),
        (["default", "--scene", "teapot"], "knob, sphere"),
        (["default", "--scene", "none.glb"], "no file"),
        (["default", "--light", "none.exr"], "none.exr"),
        (["none"], "none"),
        (["default", "--samples", "0"], "--samples"),
    ],
)
def test_the_command_refuses_in_one_line(arguments, message, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "none.glb" in arguments:
        pytest.importorskip("trimesh", reason="trimesh is not installed")
    assert message in refused(capfd, "render", *arguments, "-o", "a.png")
    assert not list(tmp_path.iterdir())
