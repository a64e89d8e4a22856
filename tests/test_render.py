"""The path tracer against closed forms, furnaces and itself: by every strategy, seed and part the same light."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from render_materials import CosineGlossy, Glossy, Shown

from warp_neural import InputError
from warp_neural.imaging.image import load_image
from warp_neural.render import Camera, Diffuse, Environment, Mesh, Renderer, Scene, combine, floor, knob, render, sphere
from warp_neural.render.materials import functions_of

SIZE = 24, 16
GLOSSY = [[0.8, 0.5, 0.3, 0.35, 0.5, 0.5]]
CLOSE = Camera(eye=(0.0, 1.2, 5.0), target=(0.0, 1.0, 0.0), fov=20.0)  # sees nothing but a ball's middle


def ball_on_floor() -> Scene:
    return Scene([sphere(material=0, columns=64), floor(material=1)])


def lamps() -> Environment:
    """A small lamp and a large one in a dim room."""
    image = np.full((16, 32, 3), 0.2)
    image[3, 14] = 60
    image[2:7, 22:27] = 3
    return Environment(image)


@pytest.fixture(scope="module")
def glossy(device):
    return combine(Glossy(GLOSSY, device), Diffuse([[0.5, 0.5, 0.5]], device=device))


def noise_of(materials, samples: int, seeds: int = 2, **options) -> tuple[np.ndarray, np.ndarray]:
    """Means of pictures with different seeds, [seeds, 3], and of all of them each pixel's."""
    pictures = [
        render(ball_on_floor(), materials, lamps(), Camera(), SIZE, samples=samples, seed=seed, **options).radiance
        for seed in range(seeds)
    ]
    return np.mean(pictures, axis=(1, 2)), np.mean(pictures, axis=0)


@pytest.mark.parametrize("strategy", ["mis", "light", "material"])
def test_a_lambert_plane_gives_the_closed_form(strategy, device):
    """Irradiance over pi, of a plane with normal n, under radiance (w.s)^2, 1 + w.s and 1:
    (1 + (n.s)^2) / 4, 1 + 2 (n.s) / 3 and 1."""
    rows = 128
    theta, phi = np.pi * (np.arange(rows)[:, None] + 0.5) / rows, np.pi * ((np.arange(2 * rows) + 0.5) / rows - 1)
    x, y, z = np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi))
    s, n = np.array([0.48, 0.6, 0.64]), np.array([0.6, 0.8, 0.0])
    along = x * s[0] + y * s[1] + z * s[2]
    environment = Environment(np.stack([along**2, 1 + along, np.ones_like(along)], axis=-1).clip(0))
    turned = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])  # takes +y to n
    albedo = np.array([0.9, 0.5, 0.7])
    scene, camera = Scene([floor(size=8).transformed(turned)]), Camera(eye=tuple(4 * n), target=(0, 0, 0), fov=10)
    materials = Diffuse([albedo], device=device)
    samples = 512
    picture = render(scene, materials, environment, camera, (16, 16), samples=samples, strategy=strategy, device=device)
    closed = albedo * [(1 + (n @ s) ** 2) / 4, 1 + 2 / 3 * (n @ s), 1]
    error = picture.radiance.std(axis=(0, 1)) / 16 + 2e-4  # of the mean; that of 128 rows of pixels
    assert (np.abs(picture.radiance.mean(axis=(0, 1)) - closed) < 3 * error).all()
    assert picture.dropped == 0 and picture.samples == samples and (picture.alpha == 1).all()
    np.testing.assert_allclose(picture.albedo, np.broadcast_to(albedo, (16, 16, 3)), rtol=1e-6)
    np.testing.assert_allclose(picture.normal, np.broadcast_to(n, (16, 16, 3)), atol=1e-6)


@pytest.mark.parametrize("columns", [12, 256])
def test_a_white_ball_vanishes_in_a_furnace(columns, device):
    """At its edge too, where views meet normals of few triangles from behind."""
    white, light = Diffuse([[1, 1, 1]], device=device), Environment.constant((2, 1, 0.5))
    camera = Camera(eye=(0, 1, 6), target=(0, 1, 0), fov=25)
    picture = render(Scene([sphere(columns=columns)]), white, light, camera, (32, 32), samples=256, device=device)
    assert 0.3 < picture.alpha.mean() < 0.9
    np.testing.assert_allclose(picture.radiance.mean(axis=(0, 1)), [2, 1, 0.5], rtol=2e-3)
    assert (np.abs(picture.radiance / [2, 1, 0.5] - 1) < 0.1).all()  # deviations of a sample are 0.3 at most


@pytest.mark.parametrize("columns", [12, 256])
def test_a_ball_does_not_shadow_itself(columns, device):
    """Light meets all of a convex surface once: its albedo is what comes back. Rays of a ball of few triangles would
    meet its own sides, a dark rim of every triangle, but for where they start."""
    grey, light = Diffuse([[0.5, 0.5, 0.5]], device=device), Environment.constant()
    picture = render(Scene([sphere(columns=columns)]), grey, light, CLOSE, (32, 32), samples=256, device=device)
    assert picture.radiance[picture.alpha == 1].mean() == pytest.approx(0.5, rel=2.5e-3)
    assert picture.radiance[picture.alpha == 1].min() > 0.43  # deviations of a sample are 0.15


def test_a_white_knob_nearly_vanishes(device):
    """It lights itself, in its groove by many bounces, which its smooth normals tell wrongly by a little."""
    white, light = Diffuse([[1, 1, 1]], device=device), Environment.constant()
    picture = render(Scene([knob()]), white, light, Camera(), (36, 36), samples=128, depth=64, device=device)
    assert picture.radiance.mean() == pytest.approx(1, abs=5e-3)
    assert picture.radiance.min() > 0.85


def test_every_strategy_gives_the_same_light(glossy, device):
    """Within three standard errors of each seed's mean; both together are less noisy than the worse one."""
    means, errors = {}, {}
    for strategy in ("mis", "light", "material"):
        values, _ = noise_of(glossy, 128, seeds=8, strategy=strategy, device=device)
        means[strategy], errors[strategy] = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(8)
    for strategy in ("light", "material"):
        apart = np.abs(means[strategy] - means["mis"])
        assert (apart < 3 * np.hypot(errors[strategy], errors["mis"])).all()
    assert errors["mis"].mean() < 0.5 * errors["material"].mean()
    assert (errors["mis"] < 0.01 * means["mis"]).all()


def test_how_a_material_is_sampled_does_not_matter(glossy, device):
    """By a cosine alone and by its highlight; neither is the other's picture, both are the same light."""
    other = combine(CosineGlossy(GLOSSY, device), Diffuse([[0.5, 0.5, 0.5]], device=device))
    one, two = (noise_of(each, 128, seeds=8, device=device)[0] for each in (glossy, other))
    error = np.hypot(one.std(axis=0, ddof=1), two.std(axis=0, ddof=1)) / np.sqrt(8)
    assert (np.abs(one.mean(axis=0) - two.mean(axis=0)) < 3 * error).all() and not np.array_equal(one, two)


def test_roulette_and_depth_are_right_on_average(device):
    """In a furnace a pit sends back what albedo and paths allow: more surfaces, more light, and never more than 1."""
    materials, light = Diffuse([[0.8, 0.8, 0.8]], device=device), Environment.constant()
    turned = knob(columns=64)
    means = []
    for depth in (1, 2, 4, 32):
        picture = render(Scene([turned]), materials, light, Camera(), SIZE, samples=256, depth=depth, device=device)
        hit = picture.alpha == 1
        means.append(picture.radiance[hit].mean())
    assert (np.diff(means) > 0).all() and means[-1] < 0.8  # of a convex one; it shadows itself
    assert means[-1] - means[-2] < 0.05


def test_noise_falls_as_one_over_the_root_of_samples(glossy, device):
    def spread(samples: int) -> float:
        a, b = (
            render(ball_on_floor(), glossy, lamps(), Camera(), SIZE, samples=samples, seed=s, device=device).radiance
            for s in (1, 2)
        )
        return float(np.median(np.abs(a - b)))

    assert spread(16) / spread(256) == pytest.approx(4, rel=0.2)  # a median of 1152 differences


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
    cpu = combine(Glossy(GLOSSY, "cpu"), Diffuse([[0.5, 0.5, 0.5]], device="cpu"))
    there = render(ball_on_floor(), cpu, lamps(), Camera(), SIZE, samples=64, device="cpu")
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
    np.testing.assert_allclose(v, np.tile(middles[:, None] / 2 + 1, 21), atol=3 * width / np.sqrt(12 * 64) + 0.002)
    assert lod[10, 10] == pytest.approx(np.log2(width), abs=0.05)
    assert lod[0, 0] > lod[10, 10]
    pair = combine(Diffuse([[0, 0, 0]], device=device), shown)
    shown.texels = 256
    finer = combine(Diffuse([[0, 0, 0]], device=device), shown)
    moved = Scene([floor(size=4, repeat=2, material=1)])
    lods = [
        render(moved, each, Environment.constant(), camera, (21, 21), samples=1, device=device).albedo[..., 2]
        for each in (pair, finer)
    ]
    np.testing.assert_allclose(lods[1] - lods[0], 8, atol=1e-5)


def test_three_sets_combine(device):
    reds = [Diffuse([[value, 0, 0]], device=device) for value in (0.25, 0.5, 0.75)]
    materials = combine(combine(reds[0], reds[1]), reds[2])
    assert materials.count == 3
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
    with pytest.raises(InputError, match="count"):
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
    assert functions_of(materials) is not None and repr(renderer.scene).startswith("Scene(Mesh(1 triangles")
