"""Points of the unit square: each in its cell, as many as the density says, and that density with them."""

import numpy as np
import pytest
import warp as wp

from warp_neural import InputError
from warp_neural.imaging.density import Density
from warp_neural.kernels.nn.random import stream, uniform
from warp_neural.kernels.shading.sampling_2d import jittered_2d

N = 200_000
COLUMNS, ROWS = 7, 5


@wp.kernel(module="unique", enable_backward=False)
def draw_kernel(
    data: Density.Data,
    jittered: wp.array[wp.vec2],
    positions: wp.array[wp.vec2],
    densities: wp.array[float],
):
    i = wp.tid()
    numbers = uniform(stream(wp.uint64(0), 0, i), 0)
    u, v = numbers[0], numbers[1]
    jittered[i] = jittered_2d(i, COLUMNS, ROWS, u, v)
    position, density = Density.sample(data, u, v)
    positions[i] = position
    densities[i] = density


@wp.kernel(module="unique", enable_backward=False)
def edge_kernel(
    data: Density.Data,
    numbers: wp.array[wp.vec2],
    jittered: wp.array[wp.vec2],
    drawn: wp.array[wp.vec2],
    columns: int,
    rows: int,
):
    i = wp.tid()
    jittered[i] = jittered_2d(i, columns, rows, numbers[i][0], numbers[i][1])
    position, _density = Density.sample(data, numbers[i][0], numbers[i][1])
    drawn[i] = position


def picture() -> np.ndarray:
    """With a black row, a black column and black ends."""
    image = np.random.default_rng(0).uniform(0, 1, (ROWS, COLUMNS))
    image[2] = image[:, 3] = image[4, 6] = image[0, 0] = 0
    return image


@pytest.fixture(scope="module")
def draws(device):
    density = Density(picture(), device=device)
    points = [wp.zeros(N, dtype=wp.vec2, device=device) for _ in range(2)]
    densities = wp.zeros(N, dtype=float, device=device)
    wp.launch(draw_kernel, N, [density.data, *points, densities], device=device)
    return [p.numpy() for p in points], densities.numpy()


def cells(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(row, column) of each point."""
    assert (points >= 0).all() and (points < 1).all()
    column, row = np.floor(points * np.float32([COLUMNS, ROWS])).astype(int).T
    return row, column


def test_jittered_points_fill_their_cells(draws):
    points = draws[0][0]
    row, column = cells(points)
    np.testing.assert_array_equal(row * COLUMNS + column, np.arange(N) % (COLUMNS * ROWS))
    share = points * [COLUMNS, ROWS] % 1
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=4 * np.sqrt(1 / 12 / N))  # 4 standard deviations
    np.testing.assert_allclose(share.var(axis=0), 1 / 12, atol=4 * np.sqrt(1 / 180 / N))


def test_points_are_drawn_where_the_image_is_bright(draws):
    """Pearson's chi-square, within 4 standard deviations of its mean; black pixels get none."""
    counts = np.zeros((ROWS, COLUMNS))
    np.add.at(counts, cells(draws[0][1]), 1)
    image = picture()
    expected = N * image / image.sum()
    lit = image > 0
    assert not counts[~lit].any()
    freedom = lit.sum() - 1
    statistic = ((counts - expected)[lit] ** 2 / expected[lit]).sum()
    assert abs(statistic - freedom) < 4 * np.sqrt(2 * freedom)


def test_points_are_uniform_within_a_pixel(draws):
    share = draws[0][1] * [COLUMNS, ROWS] % 1
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=4 * np.sqrt(1 / 12 / N))
    np.testing.assert_allclose(share.var(axis=0), 1 / 12, atol=4 * np.sqrt(1 / 180 / N))


def test_density_is_the_images(draws):
    """But for the rounding of the shares to float32."""
    image = picture()
    row, column = cells(draws[0][1])
    np.testing.assert_allclose(draws[1], (image / image.mean())[row, column], rtol=1e-6, atol=image.size * 2**-23)


def test_edges_stay_inside(device):
    """The least and the largest random numbers give no point outside, nor one of a black pixel."""
    cells = COLUMNS * ROWS
    numbers = np.zeros((2 * cells, 2))
    numbers[cells:] = 1 - 2.0**-24
    jittered, drawn = (wp.zeros(2 * cells, dtype=wp.vec2, device=device) for _ in range(2))
    arguments = [Density(picture(), device=device).data, wp.array(numbers, dtype=wp.vec2, device=device)]
    wp.launch(edge_kernel, 2 * cells, [*arguments, jittered, drawn, COLUMNS, ROWS], device=device)
    assert (jittered.numpy() < 1).all()
    first, last = drawn.numpy()[[0, -1]]
    np.testing.assert_allclose(first, [1 / 7, 0], rtol=1e-6)
    assert last[0] <= np.float32(6 / 7) and last[1] < 1


@pytest.mark.parametrize("width", [49, 4096, 9001, 16384])
def test_black_pixels_between_bright_ones_are_never_drawn(device, width):
    """Nor are pixels beside that of a jittered point, in float32 and in float64: a million points each."""
    n = 1_000_000
    image = np.zeros((2, width))
    image[0, 1::2] = 1
    image[1, ::2] = np.random.default_rng(0).uniform(0, 1, len(image[1, ::2]))
    numbers = np.random.default_rng(1).integers(0, 2**24, (n, 2)) * 2.0**-24
    jittered, drawn = (wp.zeros(n, dtype=wp.vec2, device=device) for _ in range(2))
    arguments = [Density(image, device=device).data, wp.array(numbers, dtype=wp.vec2, device=device)]
    wp.launch(edge_kernel, n, [*arguments, jittered, drawn, width, 2], device=device)
    for dtype in (np.float32, np.float64):
        column, row = (drawn.numpy().astype(dtype) * dtype([width, 2])).astype(int).T
        assert image[row, column].all()
        column, row = (jittered.numpy().astype(dtype) * dtype([width, 2])).astype(int).T
        np.testing.assert_array_equal(row * width + column, np.arange(n) % (2 * width))


def test_compiles_for_hopper(tmp_path):
    (artifact,) = wp.compile_aot_module(draw_kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.ones(4), "shape"),
        (np.ones((0, 4)), "shape"),
        (np.ones((2, 2, 3)), "shape"),
        (np.array([[1.0, -1.0]]), "negative"),
        (np.array([[1.0, np.nan]]), "not finite"),
        (np.array([[1.0, np.inf]]), "not finite"),
        (np.zeros((3, 3)), "all values are 0"),
    ],
)
def test_bad_images(image, message):
    with pytest.raises(InputError, match=message):
        Density(image)


def test_a_single_pixel_is_uniform(device):
    density = Density(np.full((1, 1), 1e-300), device=device)
    assert density.data.rows.numpy().tolist() == [0, 1] and density.data.columns.numpy().tolist() == [[0, 1]]
