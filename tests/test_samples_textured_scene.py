"""The textured scene at toy size: its geometry, accumulation, the step."""

import json
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from test_texture_filtering import random_state

from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.samples.textured_scene import step_01_on_sample, texture
from warp_neural.samples.textured_scene.fetch import fetch_picture, vec7
from warp_neural.samples.textured_scene.geometry import NOWHERE, Camera, intersect, pixel_of, ray_of, uv_along
from warp_neural.samples.textured_scene.material import tiled_material
from warp_neural.samples.textured_scene.scene import Renderer, camera_at
from warp_neural.samples.textured_scene.temporal import Accumulator, jitter_of
from warp_neural.texture.file import save_state

HEIGHT, WIDTH = 48, 72


@wp.kernel(module="unique", enable_backward=False)
def geometry_kernel(camera: Camera, uv: wp.array3d[wp.vec2], seen: wp.array3d[wp.vec2], ground: wp.array2d[int]):
    """uv of a pixel, of its right neighbour, and of that by the footprint; the place's own pixel."""
    i, j = wp.tid()
    x, y = float(j) + 0.5, float(i) + 0.5
    next = ray_of(camera, x + 1.0, y, WIDTH, HEIGHT)
    here = intersect(camera.eye, ray_of(camera, x, y, WIDTH, HEIGHT))
    right = intersect(camera.eye, next)
    uv[i, j, 0] = right.uv - here.uv
    uv[i, j, 1] = uv_along(here, camera.eye, next)
    seen[i, j, 0] = pixel_of(camera, here.position, WIDTH, HEIGHT)
    seen[i, j, 1] = wp.vec2(x, y)
    on_ground = wp.abs(here.normal[1] - 1.0) + wp.abs(right.normal[1] - 1.0) == 0.0
    both = here.distance < NOWHERE and right.distance < NOWHERE
    ground[i, j] = wp.where(both, wp.where(on_ground, 1, 2), 0)


def test_geometry(device):
    """Footprints are exact on the ground, and those of a curve on the sphere; places are seen where they were hit."""
    uv, seen = (wp.empty((HEIGHT, WIDTH, 2), dtype=wp.vec2, device=device) for _ in range(2))
    ground = wp.empty((HEIGHT, WIDTH), dtype=int, device=device)
    wp.launch(geometry_kernel, ground.shape, [camera_at(0.3), uv, seen, ground], device=device)
    (real, footprint), ground = np.moveaxis(uv.numpy(), 2, 0), ground.numpy()
    assert (ground == 1).sum() > 800 and (ground == 2).sum() > 200
    np.testing.assert_allclose(footprint[ground == 1], real[ground == 1], rtol=1e-3, atol=1e-4)
    middle = (ground == 2) & (np.abs(real).max(-1) < 0.05)  # not at outlines, nor where the angle starts again
    assert middle.sum() > 50
    np.testing.assert_allclose(footprint[middle], real[middle], rtol=0.3, atol=2e-3)
    np.testing.assert_allclose(seen.numpy()[:, :, 0], seen.numpy()[:, :, 1], atol=2e-2)


@pytest.fixture(scope="module")
def renderer(device):
    picture = np.random.default_rng(0).uniform(0.3, 0.7, (8, 8, 7)).astype(np.float32)
    picture[..., 3:6] = 0.5, 0.5, 1.0
    picture = wp.array(picture, dtype=vec7, device=device)
    return Renderer(fetch_picture, wp.array2d[vec7], picture, device, HEIGHT, WIDTH)


def test_accumulation(renderer):
    """Frames end at the reference with the camera at rest, and near it while it moves; alone they do not."""
    errors = []
    for speed in (0.0, 0.01):
        accumulator = Accumulator()
        for frame in range(24):
            camera, jitter = camera_at(speed * frame), jitter_of(frame)
            mean = accumulator.add(camera, *renderer.render(camera, jitter=jitter), jitter)
        truth = renderer.supersampled(camera, 8)
        errors += [mean - truth, renderer.render(camera)[0].numpy() - truth]
    rest, alone, moving, _ = (np.sqrt(np.square(error).mean()) for error in errors)
    assert rest < 0.3 * alone and moving < 0.7 * alone


def test_a_material_without_seams():
    material = tiled_material(64)
    for values in (material.albedo, material.normal, material.roughness):  # as different as across another joint
        assert np.abs(values[0] - values[-1]).mean() < 2 * np.abs(values[16] - values[15]).mean()
        assert np.abs(values[:, 0] - values[:, -1]).mean() < 2 * np.abs(values[:, 16] - values[:, 15]).mean()
    assert np.linalg.norm(material.normal, axis=-1) == pytest.approx(1, abs=1e-6)
    assert material.albedo.std() > 0.05 and np.ptp(material.roughness) > 0.4


def test_step_01(device, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(texture, "TEXELS", 64)
    every = step_01_on_sample.fetches
    monkeypatch.setattr(step_01_on_sample, "fetches", lambda each: {k: every(each)[k] for k in ("exact", "bilinear")})
    options = f"--device {device.alias} --out {tmp_path} --json --steps 150 --width 72 --frames 12"
    cli.run(step_01_on_sample.main, step_01_on_sample.Config, options.split())
    metrics = json.loads(capfd.readouterr().out)
    assert metrics["boiling_bilinear_alone"] > 1.3 * metrics["boiling_exact_alone"]
    assert metrics["boiling_bilinear_accumulated"] < 0.8 * metrics["boiling_bilinear_alone"]
    assert metrics["flip_bilinear_accumulated"] < metrics["flip_bilinear_alone"]
    assert metrics["milliseconds_bilinear"] > 0
    assert load_image(tmp_path / "step_01.png").std() > 0.05 and (tmp_path / "tiles.wntc").is_file()


def test_textures_of_other_maps_are_refused(tmp_path):
    path = tmp_path / "a.wntc"
    save_state(path, random_state(TextureSpec(8, 8, 7, 1, (Grid(4, 2, "bilinear"),), (8,))))
    config = step_01_on_sample.Config(device="cpu", out=tmp_path, json=True, texture=path)
    with pytest.raises(InputError, match=r"a\.wntc: give a texture of albedo, normal and roughness, 7 channels"):
        step_01_on_sample.main(config)
    with pytest.raises(InputError, match="no such file"):
        step_01_on_sample.main(step_01_on_sample.Config(device="cpu", out=tmp_path, texture=Path("missing.wntc")))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": 50}, "--steps 50: give 100 to"),
        ({"width": 8}, "--width 8: give"),
        ({"frames": 7}, "--frames 7: give"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(InputError, match=message):
        step_01_on_sample.Config(device="cpu", **options)
