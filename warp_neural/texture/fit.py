"""Contexts fitted to latents: of what the file can have nearly those under which its latents are fewest bits.

A Laplace distribution's scale is a sum of positive weights times magnitudes, its centre a sum of weights times latents;
Adam on the bits of samples of the cells. What a weight saves is known from the squares of its gradients (the Fisher
information); those that save less than they cost in the file are zero from the middle on.
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_neural.kernels.texture.fitting import LANES, VECTORS, fit_kernel
from warp_neural.texture.contexts import LARGEST, NEAR, Context, nearest_level, shapes

CELLS = 16384  # that are looked at, of all mips
BATCH = 512
STEPS = 200


def fit(grids: Sequence[np.ndarray], parents: Sequence[np.ndarray], side: int, channels: np.ndarray) -> Context:
    """grids, parents: int8 [rows, columns, n or p] of each mip, without the channels that are zero everywhere; parents
    of the next coarser grid, p = 0 without one. side: cells of a block. channels: as in `Context`."""
    n, p = grids[0].shape[2], parents[0].shape[2]
    total, random = sum(grid.shape[0] * grid.shape[1] for grid in grids), np.random.default_rng(0)
    samples = [_sample(*each, side, min(1, CELLS / total), random) for each in zip(grids, parents, strict=True)]
    own, near, above = (np.concatenate(parts) for parts in zip(*samples, strict=True))
    order = np.resize(random.permutation(len(own)), -(-len(own) // (LANES * VECTORS)) * LANES * VECTORS)
    each = np.concatenate([own, near.reshape(len(own), 6 * n), above], 1, dtype=np.int16)[order].T
    rows = _train(np.ascontiguousarray(each), _start(own, p), total) if n else np.zeros((14 + p, 0), np.float32)
    ends = np.cumsum([1, 1, 6, 6, n, n])
    upper, levels = np.triu_indices(n, 1), []
    for i, (array, largest, shape) in enumerate(zip(np.split(rows, ends), LARGEST, shapes(n, p), strict=True)):
        levels.append(nearest_level(array[upper] if i in (4, 5) else array.reshape(shape), largest))
    return Context(channels, tuple(levels))


def _sample(grid: np.ndarray, parents: np.ndarray, side: int, share: float, random: np.random.Generator) -> tuple:
    """(own [cells, n], neighbours [cells, 6, n], sums of four parents [cells, p]) of a share of the cells."""
    rows, columns, n = grid.shape
    chosen = random.permutation(rows * columns)[: max(round(rows * columns * share), 1)]
    y, x = np.divmod(chosen, columns)
    cells, near = grid.reshape(rows * columns, n), np.empty((len(chosen), 6, n), np.int8)
    for k, (dy, dx) in enumerate(NEAR):
        i, j = y + dy, x + dx
        inside = (i >= 0) & (i // side == y // side) & (j >= 0) & (j < columns) & (j // side == x // side)
        near[:, k] = cells[np.where(inside, i * columns + j, 0)] * inside[:, None]
    ratio = rows // parents.shape[0]
    up, left = y // ratio, x // ratio
    down, right = (up + 1) % parents.shape[0], (left + 1) % parents.shape[1]
    return cells[chosen], near, sum(np.abs(parents[i, j], dtype=np.int16) for i in (up, down) for j in (left, right))


def _start(own: np.ndarray, p: int) -> np.ndarray:
    """Rows of values in the order of a context, those of scales as logarithms."""
    n = own.shape[1]
    values = np.repeat(np.array([0, 0, -3, 0, -5, 0, -6], np.float32), [1, 1, 6, 6, n, n, p])[:, None].repeat(n, 1)
    values[0] = np.log(np.maximum(np.abs(own, dtype=np.float32).mean(0) / 2, 0.02))
    return values


def _train(samples: np.ndarray, start: np.ndarray, total: int) -> np.ndarray:
    """Weights; total: cells of all mips."""
    values = wp.array(start, dtype=float, device="cpu")
    inputs = [wp.array(samples, device="cpu"), values, STEPS, BATCH, total / samples.shape[1]]
    wp.launch(fit_kernel(), start.shape[1], inputs, device="cpu")
    return values.numpy()
