"""Encodings in float64 NumPy, written for clarity: `[n, n_in]` to `[n, n_out]`, and of trainable ones the gradient."""

from dataclasses import asdict
from itertools import product
from math import ceil, factorial

import numpy as np
from numpy.polynomial import Legendre

from warp_neural.kernels.nn.encodings import Concatenate, Encoding, Scaled

PRIMES = np.array([1, 2654435761, 805459861, 3674653429], np.uint64)


def identity(x):
    return x


def frequency(x, octaves, lowest):
    angles = np.pi * lowest * x[:, :, None] * 2.0 ** np.arange(octaves)
    return np.stack([np.sin(angles), np.cos(angles)], axis=-1).reshape(len(x), -1)


def triangle_wave(x, octaves):
    t = x[:, :, None] * 2.0 ** (np.arange(octaves) - 1) + np.arange(octaves) / 4
    return (4 * np.abs(t - np.floor(t) - 0.5) - 1).reshape(len(x), -1)


def one_blob(x, bins):
    """The integral of the kernel over each bin, on a circle of circumference 1."""

    def integral(edge):
        u = np.clip(bins * (edge - x), -1, 1)
        return 15 / 16 * (u - 2 / 3 * u**3 + u**5 / 5)

    turns = range(-2, 3)
    blobs = [sum(integral((k + 1) / bins + t) - integral(k / bins + t) for t in turns) for k in range(bins)]
    return np.stack(blobs, axis=-1).reshape(len(x), -1)


def spherical_harmonics(x, degree):
    columns, (x, y, z) = [], x.T
    for index in range(degree**2):
        l = int(np.sqrt(index))
        m = index - l * l - l
        n = abs(m)
        norm = np.sqrt((2 * l + 1) / (4 * np.pi) * factorial(l - n) / factorial(l + n) * (2 if m else 1))
        power = (-x - 1j * y) ** n  # the Condon-Shortley phase
        columns.append(norm * Legendre.basis(l).deriv(n)(z) * (power.imag if m < 0 else power.real))
    return np.stack(columns, axis=-1)


def texture_corners(x, width, height, wrap):
    """(texel index, weight), `[n]` each, of the four texels around x."""
    sizes = np.array([width, height])
    position = x * sizes - 0.5 if wrap else np.clip(x, 0, 1) * (sizes - 1)
    whole = np.floor(position).astype(int)
    for corner in product([0, 1], repeat=2):
        share = np.prod(np.where(corner, position - whole, 1 - position + whole), axis=1)
        texel = (whole + corner) % sizes if wrap else np.minimum(whole + corner, sizes - 1)
        yield texel[:, 1] * width + texel[:, 0], share


def grid_corners(x, level, log2_size, base_resolution, growth):
    """(entry, weight), `[n]` each, of the corners of the cell around x, and the entries in the level's table."""
    n_in = x.shape[1]
    power = np.float32(level) * np.float32(np.log2(np.float64(np.float32(growth))))  # float32, as in tiny-cuda-nn
    scale = float(np.float32(np.exp2(np.float64(power))) * np.float32(base_resolution) - np.float32(1))
    resolution = ceil(scale) + 1
    size = min(ceil(resolution**n_in / 8) * 8, 2**log2_size)
    position = x * scale + 0.5
    whole = np.floor(position).astype(np.int64)
    corners = []
    for corner in product([0, 1], repeat=n_in):
        share = np.prod(np.where(corner, position - whole, 1 - position + whole), axis=1)
        vertex = (whole + corner).astype(np.uint64)
        if resolution**n_in > 2**log2_size:
            index = np.bitwise_xor.reduce(vertex * PRIMES[:n_in] % 2**32, axis=1)
        else:
            index = (vertex * np.array([resolution**axis for axis in range(n_in)], np.uint64)).sum(axis=1)
        corners.append(((index % size).astype(int), share))
    return corners, size


def interpolate(corners, entries, dy=None):
    """Values `[n, features]` of a table `entries` `[size, features]`, or for a gradient of them the table's."""
    if dy is None:
        return sum(weight[:, None] * entries[index] for index, weight in corners)
    gradient = np.zeros_like(entries)
    for index, weight in corners:
        np.add.at(gradient, index, weight[:, None] * dy)
    return gradient


def latent_texture(x, parameters, width, height, channels, wrap, dy=None):
    texels = parameters.reshape(-1, channels)
    return interpolate(texture_corners(x, width, height, wrap), texels, dy)


def hash_grid(x, parameters, levels, features, log2_size, base_resolution, growth, dy=None):
    results, start = [], 0
    for level in range(levels):
        corners, size = grid_corners(x, level, log2_size, base_resolution, growth)
        end = start + size * features
        entries = parameters[start:end].reshape(size, features)
        part = None if dy is None else dy[:, level * features : (level + 1) * features]
        result = interpolate(corners, entries, part)
        results.append(result if dy is None else result.ravel())
        start = end
    return np.hstack(results)


def expected(encoding: Encoding, x: np.ndarray, parameters: np.ndarray, dy: np.ndarray | None = None) -> np.ndarray:
    """Values `[n, n_out]`, or with `dy` the gradient of the parameters."""
    if isinstance(encoding, Scaled):
        return expected(encoding.encoding, encoding.scale * x + encoding.offset, parameters, dy)
    if isinstance(encoding, Concatenate):
        results, start, first = [], 0, 0
        for part, indices in encoding.reads(x.shape[1]):
            n, n_out = part.n_parameters(len(indices)), part.n_out(len(indices))
            part_dy = None if dy is None else dy[:, first : first + n_out]
            results.append(expected(part, x[:, indices], parameters[start : start + n], part_dy))
            start, first = start + n, first + n_out
        return np.hstack(results)
    arguments = asdict(encoding)
    name = "".join("_" + c.lower() if c.isupper() else c for c in type(encoding).__name__)[1:]
    if arguments.pop("initial", None):
        result = globals()[name](x, parameters, **arguments, dy=dy)
        return result if dy is None else result.ravel()
    return globals()[name](x, **arguments) if dy is None else np.zeros(0)
