"""The truth about filters in float64 NumPy: sums over all texels with their weights."""

from math import erf

import numpy as np


def spline(d):
    """The cubic B-spline."""
    d = np.abs(d)
    return np.where(d < 1, 2 / 3 - d**2 + d**3 / 2, np.maximum(2 - d, 0) ** 3 / 6)


def normal_share(x):
    """Of the standard normal distribution below x."""
    return 0.5 * (1 + np.vectorize(erf)(x / np.sqrt(2)))


WEIGHTS = {
    "nearest": lambda x, i: np.float64(np.floor(x) == i),
    "bilinear": lambda x, i: np.maximum(1 - np.abs(x - (i + 0.5)), 0),
    "bicubic": lambda x, i: spline(x - (i + 0.5)),
    "gaussian": lambda x, i: normal_share((i + 1 - x) / 0.7) - normal_share((i - x) / 0.7),
}


def weights(kernel, x, n):
    """[places, n] of the texels of a line that wraps. x: [places], in texels."""
    i = np.floor(x)[:, None] + np.arange(-6, 7)
    each, found = WEIGHTS[kernel](x[:, None], i), np.zeros((len(x), n))
    np.add.at(found, (np.arange(len(x))[:, None], np.int64(i) % n), each)
    return found


def filtered(levels, kernel, uv, lod, line=(0.0, 0.0), places=1):
    """[channels] at one uv. levels: [height, width, channels] each. line: in uv, of which so many places are read."""
    lod = np.clip(lod, 0, len(levels) - 1)
    at = np.array(uv) + ((np.arange(places) + 0.5) / places - 0.5)[:, None] * np.array(line)
    total = 0.0
    for mip, level in enumerate(levels):
        share = max(1 - abs(lod - mip), 0)
        if share > 0:
            down, across = (weights(kernel, at[:, 1 - a] * level.shape[a], level.shape[a]) for a in (0, 1))
            total = total + share * np.einsum("pi,pj,ijc->c", down, across, level) / places
    return total


def ellipse(footprint, size):
    """(level of detail, line in uv). footprint: columns duv/dx, duv/dy. size: (height, width) of level 0."""
    texels = np.array([[size[1]], [size[0]]])
    axes, (major, minor), _ = np.linalg.svd(footprint * texels)
    minor = max(minor, major / 16, 1)
    return np.log2(minor), axes[:, 0] * np.sqrt(max(major**2 - minor**2, 0)) / texels[:, 0]
