"""Pictures: what they follow from, what materials are given, what is saved, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from render_materials import Glossy, Shown
from render_scenes import CLOSE, SIZE, ball_on_floor, glossy_and_floor, lamps

from warp_neural import InputError
from warp_neural.imaging.image import load_image
from warp_neural.kernels.render.geometry import Hit
from warp_neural.kernels.render.path import spread_after
from warp_neural.render import Camera, Diffuse, Environment, Mesh, Renderer, Scene, combine, floor, render, sphere


@pytest.fixture(scope="module")
def glossy(device):
    return glossy_and_floor(device)


def test_pictures_follow_from_the_seed_alone(glossy, device):
    """Not from how many samples a launch takes, nor from bands of rows on the CPU: this picture has three."""
    size = 100, 100

    def begun(seed: int) -> Renderer:
        return Renderer(ball_on_floor(), glossy, lamps(), Camera(), size, seed=seed, device=device)

    one, two, other = begun(5), begun(5), begun(6)
    one.add(3)
    two.add(1)
    two.add(2)
    other.add(3)
    first, again, different = (each.picture() for each in (one, two, other))
    for name in ("radiance", "albedo", "normal", "alpha"):
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
    assert (first.radiance != different.radiance).mean() > 0.5
    assert np.array_equal(first.radiance, render(*one_of(one), samples=3, seed=5, device=device).radiance)


def one_of(renderer: Renderer) -> tuple:
    return renderer.scene, renderer.materials, lamps(), Camera(), renderer.film.radiance.shape[::-1]


def test_devices_agree(glossy, device):
    """Single samples may part where a ray grazes an edge; means do not."""
    if device.is_cpu:
        pytest.skip("the CPU is what others are compared with")
    here = render(ball_on_floor(), glossy, lamps(), Camera(), SIZE, samples=64, device=device)
    there = render(ball_on_floor(), glossy_and_floor("cpu"), lamps(), Camera(), SIZE, samples=64, device="cpu")
    assert np.median(np.abs(here.radiance - there.radiance)) < 1e-4
    np.testing.assert_allclose(here.radiance.mean(axis=(0, 1)), there.radiance.mean(axis=(0, 1)), rtol=0.01)


def test_materials_get_the_place_and_the_footprint(device):
    """From straight above: uv of the pixel's middle, and the log2 of a pixel's width on the floor in textures."""
    shown = Shown([[0.5, 0.5, 0.5]], device=device)
    scene = Scene([floor(size=4, repeat=2)])
    camera = Camera(eye=(0, 3, 0), target=(0, 0, 0), up=(0, 0, -1), fov=30)
    picture = render(scene, shown, Environment.constant(), camera, (21, 21), samples=64, device=device)
    half = 3 * np.tan(np.radians(15))
    middles = half * (2 * (np.arange(21) + 0.5) / 21 - 1)
    width = 2 * half / 21 / 2  # of a pixel, in textures
    u, v, lod = np.moveaxis(picture.albedo, -1, 0)
    np.testing.assert_allclose(u, np.tile(middles / 2 + 1, (21, 1)), atol=3 * width / np.sqrt(12 * 64) + 0.002)
    np.testing.assert_allclose(v, np.tile(1 - middles[:, None] / 2, 21), atol=3 * width / np.sqrt(12 * 64) + 0.002)
    assert lod[10, 10] == pytest.approx(np.log2(width), abs=0.05)
    assert lod[0, 0] > lod[10, 10]
    pair = combine(Diffuse([[0, 0, 0]], device=device), shown)
    shown.texels = [256]
    finer = combine(Diffuse([[0, 0, 0]], device=device), shown)
    assert finer.texels == [1, 256]
    moved = Scene([floor(size=4, repeat=2, material=1)])
    lods = [
        render(moved, each, Environment.constant(), camera, (21, 21), samples=1, device=device).albedo[..., 2]
        for each in (pair, finer)
    ]
    np.testing.assert_allclose(lods[1] - lods[0], 8, atol=1e-5)


@wp.kernel(module="unique", enable_backward=False)
def cone_kernel(curvatures: wp.array[float], chances: wp.array[float], spreads: wp.array[float]):
    i = wp.tid()
    hit = Hit()
    hit.detail = wp.vec2(0.0, curvatures[i])
    spreads[i] = spread_after(hit, 0.01, 0.1, chances[i])


def test_cones_widen_at_curved_and_rough_surfaces(device):
    """A flat mirror leaves them, a convex one of curvature 2 adds twice 2 times the width, a Lambert surface much."""
    curvatures, chances = ([0.0, 2.0, -2.0, 0.0], [1e12, 1e12, 1e12, 1 / np.pi])
    arrays = [wp.array(values, dtype=float, device=device) for values in (curvatures, chances, [0.0] * 4)]
    wp.launch(cone_kernel, 4, arrays, device=device)
    np.testing.assert_allclose(arrays[2].numpy(), [0.01, 0.41, -0.39, 0.01 + 0.25 * np.sqrt(np.pi)], atol=1e-5)


def test_three_sets_combine(device):
    reds = [Diffuse([[value, 0, 0]], device=device) for value in (0.25, 0.5, 0.75)]
    materials = combine(combine(reds[0], reds[1]), reds[2])
    assert len(materials) == 3
    tiles = [floor(size=1, material=n).moved((n, 0, 0)) for n in range(3)]
    camera = Camera(eye=(1, 5, 0), target=(1, 0, 0), up=(0, 0, -1), fov=30)
    picture = render(Scene(tiles), materials, Environment.constant(), camera, (31, 11), samples=4, device=device)
    for n, x in enumerate((-1, 0, 1)):
        column = round(15 + x * 11 / (10 * np.tan(np.radians(15))))
        np.testing.assert_allclose(picture.albedo[5, column], [0.25 * (n + 1), 0, 0], rtol=1e-6)


def test_both_sides_are_seen_and_normals_face_the_camera(device):
    tile = floor(size=8)
    for height in (5, -5):
        camera = Camera(eye=(0, height, 0), target=(0, 0, 0), up=(0, 0, -1), fov=20)
        materials = Diffuse([[1, 1, 1]], device=device)
        picture = render(Scene([tile]), materials, Environment.constant(), camera, (8, 8), samples=64, device=device)
        np.testing.assert_allclose(picture.normal, np.broadcast_to([0, np.sign(height), 0], (8, 8, 3)), atol=1e-6)
        assert picture.radiance.mean() == pytest.approx(1, abs=0.02)  # 4096 samples that deviate by 0.3


def test_background_alpha_and_clamp(device):
    scene, materials = Scene([sphere()]), Diffuse([[0.5, 0.5, 0.5]], device=device)
    options = {"samples": 16, "device": device}
    plain = render(scene, materials, lamps(), Camera(), SIZE, background=(0.1, 0.2, 0.3), **options)
    seen = render(scene, materials, lamps(), Camera(), SIZE, **options)
    empty = plain.alpha == 0
    assert 0.2 < empty.mean() < 0.9 and np.array_equal(plain.alpha, seen.alpha)
    np.testing.assert_allclose(plain.radiance[empty], np.broadcast_to([0.1, 0.2, 0.3], (empty.sum(), 3)), rtol=1e-6)
    full = plain.alpha == 1
    assert np.array_equal(plain.radiance[full], seen.radiance[full])  # its light is the environment's all the same
    assert not plain.normal[empty].any()
    dark = render(scene, materials, lamps(), Camera(), SIZE, clamp=0.05, **options)
    assert dark.radiance[full].max() <= 0.05 * 2 * 8 and (dark.radiance[full] <= seen.radiance[full]).all()
    assert dark.radiance[full].mean() < 0.7 * seen.radiance[full].mean()


def test_pictures_are_saved(device, tmp_path):
    light = Environment.constant((4, 0.25, 0))
    picture = render(
        Scene([sphere()]), Diffuse([[1, 1, 1]], device=device), light, CLOSE, SIZE, samples=4, device=device
    )
    picture.save(tmp_path / "a.exr")
    assert np.array_equal(load_image(tmp_path / "a.exr"), picture.radiance)
    picture.save(tmp_path / "srgb.png", curve="srgb", exposure=-2)
    picture.save(tmp_path / "film.png")
    srgb = load_image(tmp_path / "srgb.png")
    np.testing.assert_allclose(srgb, np.clip(picture.radiance / 4, 0, 1), atol=0.005)  # 8 bits
    film = load_image(tmp_path / "film.png", color_space="linear")
    np.testing.assert_allclose(film, picture.shown(), atol=0.5 / 255 + 1e-6)
    assert 0.9 < picture.shown()[..., 0].mean() < 1 and picture.shown()[..., 2].max() == 0
    half = replace(picture, alpha=np.full_like(picture.alpha, 0.5))
    half.save(tmp_path / "alpha.exr", alpha=True)
    saved = load_image(tmp_path / "alpha.exr")
    np.testing.assert_allclose(saved[..., :3], 2 * picture.radiance, rtol=1e-6)
    assert (saved[..., 3] == 0.5).all()
    picture.save_features(tmp_path)
    np.testing.assert_allclose(load_image(tmp_path / "normal.exr"), picture.normal, atol=1e-6)


def test_time_ends_a_picture(device):
    scene, materials = ball_on_floor(), Diffuse([[0.5, 0.5, 0.5]] * 2, device=device)
    options = {"samples": 10**6, "seconds": 0.05, "device": device}
    assert 1 <= render(scene, materials, lamps(), Camera(), SIZE, **options).samples < 10**6


def test_hostile_materials_make_no_nan(device):
    """A set that gives NaN and infinity, directions among them: those samples are black and counted."""

    class Broken(Shown):
        evaluate, sample = broken_evaluate, broken_sample

    picture = render(
        ball_on_floor(), Broken([[0.5] * 3] * 2, device=device), lamps(), CLOSE, SIZE, samples=4, device=device
    )
    assert picture.dropped > 0 and np.isfinite(picture.radiance).all()


@wp.func
def broken_evaluate(p: Diffuse.Params, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> wp.vec3:
    return wp.vec3(0.0 / (light[2] - light[2]), 1.0 / (light[2] - light[2]), 1.0)


@wp.func
def broken_sample(p: Diffuse.Params, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3) -> wp.vec3:
    none = view[2] - view[2]
    return wp.vec3(1.0 / none, wp.where(u[0] < 0.5, 0.0, 0.0 / none), 1.0)


class Mistaken(Diffuse):
    """Its functions take other parameters than it has."""

    Params = Glossy.Params


@pytest.mark.parametrize(
    "options, message",
    [
        ({"samples": 0}, "samples"),
        ({"seconds": 0}, "seconds"),
        ({"depth": 0}, "depth"),
        ({"seed": -1}, "seed"),
        ({"clamp": -1}, "clamp"),
        ({"strategy": "both"}, "strategy"),
        ({"size": (0, 5)}, "width"),
        ({"size": 5}, "size"),
        ({"size": (60000, 60000)}, "pixels"),
        ({"device": "cuda:99"}, "device"),
        ({"materials": Mistaken([[0.5] * 3] * 2, device="cpu")}, "no instance of Params"),
        ({"materials": object()}, "has no params, Params, evaluate"),
        ({"camera": Camera(eye=(0, 0, 0), target=(0, 1, 0))}, "along up"),
        ({"camera": Camera(eye=(0, np.nan, 0))}, "eye"),
        ({"camera": Camera(fov=180)}, "fov"),
        ({"background": (1, 2)}, "background"),
        ({"scene": Scene([floor(material=3)])}, "number 3"),
    ],
)
def test_what_cannot_be_rendered_is_refused(options, message):
    given = {"scene": ball_on_floor(), "materials": Diffuse([[0.5] * 3] * 2, device="cpu"), "device": "cpu"}
    given |= {"environment": Environment.constant(), "camera": Camera(), "size": SIZE, "samples": 1}
    with pytest.raises(InputError, match=message):
        render(**(given | options))


def test_scenes_and_sets_are_checked():
    with pytest.raises(InputError, match="at least one"):
        Scene([])
    with pytest.raises(InputError, match="albedos"):
        Diffuse([[0.5, 0.5, 1.5]], device="cpu")
    with pytest.raises(InputError, match="length"):
        combine(type("Set", (), {})(), Diffuse([[0, 0, 0]], device="cpu"))
    with pytest.raises(InputError, match="curve"):
        one = render(
            Scene([floor()]), Diffuse([[0, 0, 0]], device="cpu"), lamps(), Camera(), SIZE, samples=1, device="cpu"
        )
        one.shown(curve="none")


def test_the_mesh_lives_as_long_as_its_scene(device):
    """Of one triangle, made and let go: rays still meet what was there."""
    scene = Scene([Mesh(np.eye(3) * 3, np.array([[0, 1, 2]]))])
    materials, light = Diffuse([[1, 1, 1]], device=device), Environment.constant()
    renderer = Renderer(scene, materials, light, Camera(eye=(5, 5, 5), target=(1, 1, 1)), SIZE, device=device)
    del scene
    renderer.add(4)
    assert renderer.picture().alpha.max() == 1
    assert repr(renderer.scene).startswith("Scene(Mesh(1 triangles")
