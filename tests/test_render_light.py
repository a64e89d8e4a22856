"""The environment: directions, a density that integrates to one, and draws that follow it."""

import numpy as np
import pytest
import warp as wp
from scipy.stats import chisquare

from warp_neural import InputError
from warp_neural.imaging.image import save_image
from warp_neural.kernels.nn.random import stream, uniform
from warp_neural.kernels.render.environment import (
    EnvironmentData,
    bilinear,
    density_at,
    direction_of,
    place_of,
    sample_environment,
)
from warp_neural.render import Environment

N = 400_000
HEIGHT, WIDTH = 6, 9


@wp.kernel(module="unique", enable_backward=False)
def draw_kernel(environment: EnvironmentData, places: wp.array[wp.vec2], back: wp.array[wp.vec2]):
    i = wp.tid()
    u = uniform(stream(wp.uint64(3), 0, i), 0)
    places[i] = sample_environment(environment, u[0], u[1])
    back[i] = place_of(environment, direction_of(environment, places[i]))


@wp.kernel(module="unique", enable_backward=False)
def look_kernel(
    environment: EnvironmentData,
    directions: wp.array[wp.vec3],
    radiance: wp.array[wp.vec3],
    densities: wp.array[float],
):
    i = wp.tid()
    place = place_of(environment, directions[i])
    radiance[i] = bilinear(environment.radiance, place)
    densities[i] = density_at(environment, place)


def picture() -> np.ndarray:
    """Random, with a dark row, a dark column and a lamp."""
    image = np.random.default_rng(0).uniform(0.1, 1, (HEIGHT, WIDTH, 3))
    image[2] = image[:, 4] = 0
    image[1, 7] = 40
    return image


def look(environment: Environment, directions: np.ndarray, device: wp.Device) -> tuple[np.ndarray, np.ndarray]:
    data = environment.data(device)
    radiance = wp.zeros(len(directions), dtype=wp.vec3, device=device)
    densities = wp.zeros(len(directions), dtype=float, device=device)
    inputs = [data, wp.array(directions, dtype=wp.vec3, device=device), radiance, densities]
    wp.launch(look_kernel, len(directions), inputs, device=device)
    return radiance.numpy(), densities.numpy()


def grid(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions on a fine grid, [2 rows^2, 3], and their solid angles."""
    theta = np.pi * (np.arange(rows) + 0.5) / rows
    phi = np.pi * (np.arange(2 * rows) + 0.5) / rows
    theta, phi = (each.reshape(-1) for each in np.meshgrid(theta, phi, indexing="ij"))
    directions = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1)
    return directions, np.sin(theta) * (np.pi / rows) ** 2


def test_the_density_integrates_to_one(device):
    directions, angles = grid(400)
    for environment in (Environment(picture(), rotation=77), Environment.studio(height=32), Environment.constant()):
        _, densities = look(environment, directions, device)
        assert (densities > 0).all() or environment.image.min() == 0
        assert densities @ angles == pytest.approx(1, abs=1e-4)  # midpoints of a piecewise smooth function


def test_a_constant_environment_is_drawn_from_evenly(device):
    """Within a row of pixels and their sine."""
    directions, _ = grid(50)
    _, densities = look(Environment(np.ones((256, 512, 3))), directions, device)
    np.testing.assert_allclose(densities, 1 / (4 * np.pi), rtol=1e-3)


def test_draws_follow_the_density(device):
    """Chi-square over 5 x 5 parts of each pixel, whose shares are integrals of the bilinear weights in float64."""
    environment = Environment(picture())
    places, back = (wp.zeros(N, dtype=wp.vec2, device=device) for _ in range(2))
    wp.launch(draw_kernel, N, [environment.data(device)], [places, back], device=device)
    places, back = places.numpy(), back.numpy()
    assert (places >= 0).all() and (places <= 1).all()
    apart = np.abs(back - places)
    assert np.minimum(apart, 1 - apart).max() < 1e-5
    parts = 5
    shape, fine = (HEIGHT * parts, WIDTH * parts), 8
    y, x = (((np.arange(n * fine) + 0.5) / fine / parts - 0.5) for n in shape)
    weights = environment.data(device).weights.numpy().astype(np.float64)
    rows = np.clip(np.stack([np.floor(y), np.floor(y) + 1]).astype(int), 0, HEIGHT - 1)
    columns = np.stack([np.floor(x), np.floor(x) + 1]).astype(int) % WIDTH
    fy, fx = (y - np.floor(y))[:, None], (x - np.floor(x))[None]
    corners = [[weights[np.ix_(i, j)] for j in columns] for i in rows]
    values = (1 - fy) * ((1 - fx) * corners[0][0] + fx * corners[0][1])
    values += fy * ((1 - fx) * corners[1][0] + fx * corners[1][1])
    expected = values.reshape(shape[0], fine, shape[1], fine).mean(axis=(1, 3))
    expected *= N / expected.sum()
    counts, _, _ = np.histogram2d(*places.T[::-1], bins=shape, range=[[0, 1], [0, 1]])
    enough = expected > 8
    left = N - expected[enough].sum(), N - counts[enough].sum()
    observed, wanted = np.append(counts[enough], left[1]), np.append(expected[enough], left[0])
    assert enough.sum() > 500 and chisquare(observed, wanted).pvalue > 1e-3
    assert counts[expected == 0].sum() == 0


def test_the_middle_lies_ahead_and_the_right_half_to_the_right(device):
    image = np.zeros((64, 128, 3))
    image[16, 80] = 1  # above the middle, and to the right of it
    directions, _ = grid(128)
    radiance, _ = look(Environment(image), directions, device)
    x, y, z = directions[radiance[:, 0].argmax()]
    assert z < -0.4 and x > 0.4 and y > 0.5
    radiance, _ = look(Environment(image, rotation=90), directions, device)
    a, b, c = directions[radiance[:, 0].argmax()]
    assert b == pytest.approx(y, abs=0.03) and a == pytest.approx(-z, abs=0.03) and c == pytest.approx(x, abs=0.03)


def test_radiance_is_bilinear_between_pixels(device):
    rows = 64
    directions, _ = grid(256)
    theta = np.pi * (np.arange(rows) + 0.5) / rows
    image = np.broadcast_to(np.cos(theta)[:, None, None] ** 2, (rows, 2 * rows, 3))
    radiance, _ = look(Environment(image, scale=2), directions, device)
    np.testing.assert_allclose(radiance[:, 0], 2 * directions[:, 1] ** 2, atol=2e-3)  # of pi / 64, squared


def test_a_black_environment_is_drawn_from_too(device):
    directions, angles = grid(100)
    radiance, densities = look(Environment(np.zeros((32, 64, 3))), directions, device)
    assert not radiance.any() and densities @ angles == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("suffix", [".exr", ".hdr"])
def test_files_are_linear_light(suffix, tmp_path):
    image = np.random.default_rng(1).uniform(0, 50, (4, 8, 3)).astype(np.float32)
    save_image(tmp_path / f"light{suffix}", image)
    loaded = Environment.load(tmp_path / f"light{suffix}", scale=0.5).image
    np.testing.assert_allclose(loaded, 0.5 * image, atol=0 if suffix == ".exr" else 0.1)  # RGBE: 8 bits


def test_the_shared_environments_load(shared_data):
    environment = Environment.load(shared_data / "hdr" / "venice_sunset_1k.hdr")
    assert environment.image.shape == (512, 1024, 3) and environment.image.max() > 1000
    with pytest.raises(InputError, match=r"workshop_dwab\.exr: environment: negative"):
        Environment.load(shared_data / "hdr" / "workshop_dwab.exr")


@pytest.mark.parametrize(
    "image, options, message",
    [
        (np.ones((4, 8)), {}, "shape"),
        (-np.ones((4, 8, 3)), {}, "negative"),
        (np.full((4, 8, 3), np.nan), {}, "not finite"),
        ("sky", {}, "no array of numbers"),
        (np.ones((4, 8, 3)), {"rotation": np.inf}, "degrees"),
        (np.ones((4, 8, 3)), {"scale": -1}, "scale"),
        (np.ones((4, 8, 3)), {"scale": 1e30}, "scale"),
    ],
)
def test_what_is_no_light_is_refused(image, options, message):
    with pytest.raises(InputError, match=message):
        Environment(image, **options)
