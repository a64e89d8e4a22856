"""Contexts fitted to latents: of what the file can have nearly those under which its latents are fewest bits.

A Laplace distribution's scale is a sum of positive weights times magnitudes, its centre a sum of weights times latents;
Adam on the bits of samples of the cells. What a weight saves is known from the squares of its gradients (the Fisher
information); those that save less than they cost in the file are zero from the middle on.
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_neural.kernels.texture.fitting import LANES, VECTORS, fit_kernel, sample_kernel
from warp_neural.texture.contexts import LARGEST, Context, nearest_level, shapes

CELLS = 16384  # that are looked at, of all mips
BATCH = 512
STEPS = 200


def fit(grids: Sequence[np.ndarray], parents: Sequence[np.ndarray], side: int, channels: np.ndarray) -> Context:
    """grids, parents: int8 [rows, columns, n or p] of each mip, without the channels that are zero everywhere; parents
    of the next coarser grid, p = 0 without one. side: cells of a block. channels: as in `Context`."""
    n, p = grids[0].shape[2], parents[0].shape[2]
    total, rows = sum(grid.shape[0] * grid.shape[1] for grid in grids), np.zeros((14 + p, 0), np.float32)
    if n:
        samples = _samples(grids, parents, side, total)
        rows = _train(samples, _start(samples.numpy()[:n], p), total)
    ends = np.cumsum([1, 1, 6, 6, n, n])
    upper, levels = np.triu_indices(n, 1), []
    for i, (array, largest, shape) in enumerate(zip(np.split(rows, ends), LARGEST, shapes(n, p), strict=True)):
        levels.append(nearest_level(array[upper] if i in (4, 5) else array.reshape(shape), largest))
    return Context(channels, tuple(levels))


def _samples(grids: Sequence[np.ndarray], parents: Sequence[np.ndarray], side: int, total: int) -> wp.array:
    """int16 [7 n + p, cells], of some cells of each mip, in any order, as `fit_kernel` has them; on the CPU."""
    random, share = np.random.default_rng(0), min(1, CELLS / total)
    sizes = [grid.shape[0] * grid.shape[1] for grid in grids]
    cells = [random.choice(size, max(round(size * share), 1), replace=False) for size in sizes]
    count = sum(map(len, cells))
    whole = (-(-count // (LANES * VECTORS)) | 1) * LANES * VECTORS  # odd: rows share no lines of caches
    order = np.resize(random.permutation(count), whole)
    mips = np.repeat(np.arange(len(grids)), [len(each) for each in cells])[order]
    cells = np.concatenate(cells)[order].astype(np.int32)
    samples = wp.empty((7 * grids[0].shape[2] + parents[0].shape[2], whole), wp.int16, "cpu")
    for mip, pair in enumerate(zip(grids, parents, strict=True)):
        places = np.flatnonzero(mips == mip).astype(np.int32)
        arrays = [wp.array(each, dtype=wp.int8, device="cpu", copy=False) for each in pair]
        arrays += [wp.array(each, dtype=int, device="cpu") for each in (cells[places], places)]
        wp.launch(sample_kernel, len(places), [*arrays, side, samples], device="cpu", record_tape=False)
    return samples


def _start(own: np.ndarray, p: int) -> np.ndarray:
    """own: [n, cells]. Rows of values in the order of a context, those of scales as logarithms."""
    n = len(own)
    values = np.repeat(np.array([0, 0, -3, 0, -5, 0, -6], np.float32), [1, 1, 6, 6, n, n, p])[:, None].repeat(n, 1)
    values[0] = np.log(np.maximum(np.abs(own, dtype=np.float32).mean(1) / 2, 0.02))
    return values


def _train(samples: wp.array, start: np.ndarray, total: int) -> np.ndarray:
    """Weights; total: cells of all mips."""
    values = wp.array(start, dtype=float, device="cpu")
    inputs = [samples, values, STEPS, BATCH, total / samples.shape[1]]
    wp.launch(fit_kernel(), start.shape[1], inputs, device="cpu")
    return values.numpy()
