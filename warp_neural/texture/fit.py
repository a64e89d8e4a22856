"""Contexts fitted to latents: of what the file can have nearly those under which its latents are fewest bits.

A Laplace distribution's scale is a sum of positive weights times magnitudes, its centre a sum of weights times latents;
Adam on the bits of samples of the cells. What a weight saves is known from the squares of its gradients (the Fisher
information); those that save less than they cost in the file are zero from the middle on.
"""

from collections.abc import Sequence

import numpy as np

from warp_neural.texture.contexts import LARGEST, NEAR, SIGNED, Context, nearest_level

CELLS = 16384  # that are looked at, of all mips
BATCH = 2048
WEIGHT_BITS = 8  # of a weight in the file, about
LEAST = np.float32(2**-20)  # of a probability: what the tables do not have


def fit(
    grids: Sequence[np.ndarray], parents: Sequence[np.ndarray], side: int, channels: np.ndarray, steps: int
) -> Context:
    """grids, parents: int8 [rows, columns, n or p] of each mip, without the channels that are zero everywhere; parents
    of the next coarser grid, p = 0 without one. side: cells of a block. channels: as in `Context`."""
    n = grids[0].shape[2]
    total, random = sum(grid.shape[0] * grid.shape[1] for grid in grids), np.random.default_rng(0)
    samples = [_sample(*each, side, min(1, CELLS / total), random) for each in zip(grids, parents, strict=True)]
    own, near, above = (np.concatenate(parts) for parts in zip(*samples, strict=True))
    order = random.permutation(len(own))
    model = _Model(own[order], near[order], above[order])
    if n:
        model.train(steps, total / len(own))
    levels = [nearest_level(*each) for each in zip(model.weights(), LARGEST, strict=True)]
    upper = np.triu_indices(n, 1)
    return Context(channels, tuple(array[upper] if i in (4, 5) else array for i, array in enumerate(levels)))


def _sample(grid: np.ndarray, parents: np.ndarray, side: int, share: float, random: np.random.Generator) -> tuple:
    """(own [cells, n], neighbours [6, cells, n], sums of four parents [cells, p]) of a share of the cells, float32."""
    rows, columns, n = grid.shape
    chosen = np.sort(random.permutation(rows * columns)[: max(round(rows * columns * share), 1)])
    y, x = np.divmod(chosen, columns)
    near = np.zeros((6, len(chosen), n), np.float32)
    for k, (dy, dx) in enumerate(NEAR):
        i, j = y + dy, x + dx
        inside = (i >= 0) & (i // side == y // side) & (j >= 0) & (j < columns) & (j // side == x // side)
        near[k, inside] = grid[i[inside], j[inside]]
    ratio = rows // parents.shape[0]
    up, left = y // ratio, x // ratio
    down, right = (up + 1) % parents.shape[0], (left + 1) % parents.shape[1]
    above = sum(np.abs(parents[i, j]).astype(np.float32) for i in (up, down) for j in (left, right))
    return grid[y, x].astype(np.float32), near.transpose(1, 0, 2), above


class _Model:
    """Weights of magnitudes as logarithms; names and order as in `contexts.shapes`, channels before as [n, n]."""

    def __init__(self, own: np.ndarray, near: np.ndarray, above: np.ndarray) -> None:
        self.own, self.near, self.above = own, near, above
        n, p = own.shape[1], above.shape[1]
        after = np.triu(np.ones((n, n), np.float32), 1)
        start = np.log(np.maximum(np.abs(own).mean(0) / 2, 0.02))
        self.values = [start, np.zeros(n), np.full((6, n), -3), np.zeros((6, n))]
        self.values = [*self.values, np.full((n, n), -5), np.zeros((n, n)), np.full((p, n), -6)]
        self.values = [array.astype(np.float32) for array in self.values]
        self.kept = [np.ones_like(array) for array in self.values]
        self.kept[4], self.kept[5] = after, after.copy()

    def weights(self) -> list[np.ndarray]:
        parts = zip(self.values, self.kept, strict=True)
        return [(value if i in SIGNED else np.exp(value)) * kept for i, (value, kept) in enumerate(parts)]

    def train(self, steps: int, cells: float) -> None:
        """cells: how many one of the sample stands for."""
        moments = [(np.zeros_like(array), np.zeros_like(array)) for array in self.values]
        batches = max(len(self.own) // BATCH, 1)
        for step in range(steps):
            if step == steps // 2:
                self.drop(cells)
            first = step % batches * BATCH
            rate, gradients = 0.06 * (1 - step / steps) + 0.003, self.gradients(slice(first, first + BATCH))
            for i, (gradient, (mean, square)) in enumerate(zip(gradients, moments, strict=True)):
                mean += 0.1 * (gradient - mean)
                square += 0.01 * (gradient * gradient - square)
                ahead = mean / (1 - 0.9 ** (step + 1)) / (np.sqrt(square / (1 - 0.99 ** (step + 1))) + 1e-9)
                self.values[i] -= np.float32(rate * (0.2 if i in SIGNED else 1)) * ahead

    def gradients(self, rows: slice) -> list[np.ndarray]:
        """Of the bits a cell."""
        products = self.products(rows, 1)
        weights = self.weights()
        return [
            array * (kept if i in SIGNED else weights[i])
            for i, (array, kept) in enumerate(zip(products, self.kept, strict=True))
        ]

    def drop(self, cells: float) -> None:
        """Weights whose loss costs fewer bits than they do: half the square times the curvature, in nats."""
        curvatures, weights = self.products(slice(None), 2), self.weights()
        for i in range(1, len(weights)):
            bits = weights[i] ** 2 * curvatures[i] * (len(self.own) * cells * np.log(2) / 2)
            self.kept[i] *= bits > WEIGHT_BITS

    def products(self, rows: slice, power: int) -> list[np.ndarray]:
        """Means over cells of the derivatives of the bits by each weight, to a power."""
        own, near, above = self.own[rows], self.near[rows], self.above[rows]
        scale_0, mean_0, scale_near, mean_near, scale_of, mean_of, scale_parent = self.weights()
        size, near_size = np.abs(own), np.abs(near)
        scale = scale_0 + np.einsum("ikc,kc->ic", near_size, scale_near) + size @ scale_of + above @ scale_parent
        mean = mean_0 + np.einsum("ikc,kc->ic", near, mean_near) + own @ mean_of
        d_scale, d_mean = (array**power / len(own) for array in _derivatives(own, mean, scale))
        own, near, size, near_size, above = (array**power for array in (own, near, size, near_size, above))
        near_sums = np.einsum("ikc,ic->kc", near_size, d_scale), np.einsum("ikc,ic->kc", near, d_mean)
        return [d_scale.sum(0), d_mean.sum(0), *near_sums, size.T @ d_scale, own.T @ d_mean, above.T @ d_scale]


def _derivatives(latents: np.ndarray, mean: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the bits of latents by their scale and mean: of a Laplace distribution's part half a step around them."""
    scale = np.maximum(scale, np.float32(1 / 64))
    distance, half = np.abs(latents - mean), np.float32(0.5)
    inner, outer = np.exp(-np.abs(distance - half) / scale), np.exp(-(distance + half) / scale)
    probability = half * np.where(distance > half, inner - outer, 2 - inner - outer)
    factor = np.float32(-0.5 / np.log(2)) / (np.maximum(probability, LEAST) * scale)
    d_scale = factor * (inner * (distance - half) - outer * (distance + half)) / scale
    return d_scale, factor * (outer - inner) * np.sign(mean - latents)
