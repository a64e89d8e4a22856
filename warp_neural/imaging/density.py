"""`Density`: draw points of the unit square where an image is bright."""

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.shading.sampling_2d import DensityData, sample_density


class Density:
    """A probability density over [0, 1)^2 proportional to the pixels of `image` `[height, width]`, row 0 at y = 0.

    In a kernel that takes `data: Density.Data`, `position, density = Density.sample(data, u, v)` draws one from two
    uniform numbers in [0, 1), with its density relative to a uniform draw's; pass `self.data`. Image values are finite,
    not negative and not all zero. Shares of a row, and of the image, are in steps of 2^-24: smaller ones may be lost.
    """

    Data = DensityData
    sample = staticmethod(sample_density)

    def __init__(self, image: np.ndarray, *, device: wp.DeviceLike = None):
        device = find_device(device)
        try:
            image = np.asarray(image, np.float64)
        except (TypeError, ValueError):
            raise InputError("image: no array of numbers; a density takes [height, width]") from None
        if image.ndim != 2 or 0 in image.shape:
            raise InputError(f"image: shape {image.shape}; a density takes [height, width], at least one pixel")
        if not np.isfinite(image).all() or image.min() < 0:
            raise InputError("image: negative or not finite values; a density takes values of at least 0")
        if image.max() == 0:
            raise InputError("image: all values are 0; a density needs one above")
        image = image / image.max()
        sums = image.sum(axis=1)
        rows = shares(sums[None])[0]
        columns = shares(np.where(sums[:, None] > 0, image, 1))
        self.shape = image.shape
        self.data = DensityData()
        self.data.rows = wp.array(rows, dtype=float, device=device)  # [height + 1]
        self.data.columns = wp.array(columns, dtype=float, device=device)  # [height, width + 1]

    def __repr__(self) -> str:
        return f"Density({self.shape[0]} x {self.shape[1]}, {self.data.rows.device.alias})"


def shares(values: np.ndarray) -> np.ndarray:
    """`[n, m]` to `[n, m + 1]`: the share of each row's sum before each value, from 0 to exactly 1."""
    total = np.cumsum(values, axis=1)
    return np.hstack([np.zeros((len(values), 1)), total / total[:, -1:]]).astype(np.float32)
