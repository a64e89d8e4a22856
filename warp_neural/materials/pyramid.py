"""Mip levels of maps of any size."""

import numpy as np

Pyramid = list[np.ndarray]
"""Levels `[height, width, channels]`, the finest first, each half of the one before, down to one texel."""


def pyramid(image: np.ndarray) -> Pyramid:
    levels = [np.ascontiguousarray(image, np.float32)]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(halved(halved(levels[-1], 0), 1))
    return levels


def halved(image: np.ndarray, axis: int) -> np.ndarray:
    """Half as many texels, at least one, along the axis: means of the area, so odd sizes weigh the texels between."""
    count = image.shape[axis]
    half = max(count // 2, 1)
    if count == 2 * half:
        pairs = np.moveaxis(image, axis, 0)
        return np.moveaxis((pairs[::2] + pairs[1::2]) * np.float32(0.5), 0, axis)
    zeros = np.zeros_like(np.take(image, [0], axis), dtype=np.float64)
    sums = np.concatenate([zeros, np.cumsum(image, axis, dtype=np.float64)], axis)
    edges = np.arange(half + 1) * (count / half)
    below = np.minimum(edges.astype(int), count - 1)
    share = (edges - below).reshape([-1 if i == axis else 1 for i in range(image.ndim)])
    at_edges = np.take(sums, below, axis) * (1 - share) + np.take(sums, below + 1, axis) * share
    return (np.diff(at_edges, axis=axis) * (half / count)).astype(np.float32)
