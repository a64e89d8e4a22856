"""The path tracer against closed forms, furnaces and itself: by every strategy the same light."""

import numpy as np
import pytest
from render_materials import CosineGlossy
from render_scenes import CLOSE, GLOSSY, SIZE, ball_on_floor, glossy_and_floor, lamps

from warp_neural.render import Camera, Diffuse, Environment, Mesh, Scene, combine, floor, knob, render, sphere


@pytest.fixture(scope="module")
def glossy(device):
    return glossy_and_floor(device)


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


def test_a_cavity_gives_the_closed_form_of_all_its_bounces(device):
    """Inside of a sphere every part of the wall sees all others alike: with albedo a and a share f of it cut off, the
    rest has radiance a f / (1 - a (1 - f)) in a furnace. Roulette ends most of the paths."""
    whole, albedo = sphere(), 0.8
    height = whole.positions[whole.triangles][..., 1].max(axis=1)
    cut = Mesh(whole.positions, whole.triangles[height < 1.5001], whole.normals, whole.uvs)
    share = (1 - (cut.positions[:, 1].max() - 1)) / 2
    closed = albedo * share / (1 - albedo * (1 - share))
    materials, light = Diffuse([[albedo] * 3], device=device), Environment.constant()
    camera = Camera(eye=(0, 7, 0), target=(0, 0, 0), up=(0, 0, -1), fov=8)
    means = []
    for depth in (1, 3, 64):
        picture = render(Scene([cut]), materials, light, camera, (24, 24), samples=256, depth=depth, device=device)
        means.append(picture.radiance.mean())
    assert picture.alpha.min() == 1
    error = picture.radiance[..., 0].std() / 24
    assert abs(means[-1] - closed) < 3 * error + 1e-3 * closed  # 256 flat sides
    np.testing.assert_allclose(means[0], albedo * share, rtol=0.01)
    np.testing.assert_allclose(means[1] / closed, 1 - (albedo * (1 - share)) ** 3, rtol=0.01)


def test_noise_falls_as_one_over_the_root_of_samples(glossy, device):
    def spread(samples: int) -> float:
        a, b = (
            render(ball_on_floor(), glossy, lamps(), Camera(), SIZE, samples=samples, seed=s, device=device).radiance
            for s in (1, 2)
        )
        return float(np.median(np.abs(a - b)))

    assert spread(16) / spread(256) == pytest.approx(4, rel=0.2)  # a median of 1152 differences
