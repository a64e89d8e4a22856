"""Kernels that fit the context of a grid's latents to samples of them."""

from functools import cache
from pathlib import Path

import warp as wp

from warp_neural.kernels.native import paste

LANES, VECTORS = 8, 4  # samples side by side: cells are a multiple of both
LEAST = 2.0**-20  # of a probability: what the tables do not have
WEIGHT_BITS = 8.0  # of a weight in the file, about
MOST = 14 + 3 * 32  # weights of a channel

_CONSTANTS = {"LANES": LANES, "VECTORS": VECTORS, "LEAST": LEAST, "WEIGHT_BITS": WEIGHT_BITS, "MOST": MOST}


@wp.func
def sample(
    grid: wp.array3d[wp.int8], y: int, x: int, up: int, left: int, side: int, row: int, at: int,
    samples: wp.array2d[wp.int16],
):  # fmt: skip
    """The latents so far up and left of (y, x), 0 outside its block, to rows from `row` on."""
    n, i, j = grid.shape[2], y - up, x - left
    if i >= y // side * side and j >= x // side * side and j < wp.min(x // side * side + side, grid.shape[1]):
        for c in range(n):
            samples[row * n + c, at] = wp.int16(grid[i, j, c])
    else:
        for c in range(n):
            samples[row * n + c, at] = wp.int16(0)


@wp.kernel(enable_backward=False)
def sample_kernel(
    grid: wp.array3d[wp.int8], parents: wp.array3d[wp.int8], cells: wp.array[int], places: wp.array[int], side: int,
    samples: wp.array2d[wp.int16],
):  # fmt: skip
    """What a latent's context has of one cell, to column places[i] of samples, as `fit_channel.h` reads it."""
    i = wp.tid()
    y, x, at = cells[i] // grid.shape[1], cells[i] % grid.shape[1], places[i]
    sample(grid, y, x, 0, 0, side, 0, at, samples)
    sample(grid, y, x, 0, 1, side, 1, at, samples)
    sample(grid, y, x, 1, 0, side, 2, at, samples)
    sample(grid, y, x, 1, 1, side, 3, at, samples)
    sample(grid, y, x, 1, -1, side, 4, at, samples)
    sample(grid, y, x, 0, 2, side, 5, at, samples)
    sample(grid, y, x, 2, 0, side, 6, at, samples)
    ratio = grid.shape[0] // parents.shape[0]
    up, left = y // ratio, x // ratio
    down, right = (up + 1) % parents.shape[0], (left + 1) % parents.shape[1]
    for p in range(parents.shape[2]):
        upper = wp.abs(wp.int16(parents[up, left, p])) + wp.abs(wp.int16(parents[up, right, p]))
        lower = wp.abs(wp.int16(parents[down, left, p])) + wp.abs(wp.int16(parents[down, right, p]))
        samples[7 * grid.shape[2] + p, at] = upper + lower


@cache
def fit_kernel() -> wp.Kernel:
    """Thread c trains the weights of channel c, the CPU's alone. values: in, where each begins, out, the weights."""

    @wp.func_native(paste(Path(__file__).parent / "native" / "fit_channel.h", **_CONSTANTS))
    def fit_channel(
        samples: wp.array2d[wp.int16], values: wp.array2d[float], channel: int, steps: int, batch: int,
        stands_for: float,
    ): ...  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False)
    def fit(samples: wp.array2d[wp.int16], values: wp.array2d[float], steps: int, batch: int, stands_for: float):
        fit_channel(samples, values, wp.tid(), steps, batch, stands_for)

    return fit
