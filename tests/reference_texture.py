"""The truth about neural textures in float64 NumPy: grids read by kernels, the network, the rate, their gradients."""

import numpy as np
import reference_networks as networks


def taps_of(grid, tensors, g):
    """[scale, scale, 4, channels]: weights by phase, of the latents of the own cell, right, below, right below."""
    if grid.kernel == "learned":
        return np.moveaxis(tensors[f"kernel_{g}"], 0, -1)
    if grid.kernel == "separable":
        y, x = (tensors[f"kernel_{g}_{axis}"] for axis in "yx")
        return np.einsum("cya,cxb->yxabc", y, x).reshape(grid.scale, grid.scale, 4, grid.channels)
    f = (np.arange(grid.scale) + 0.5) / grid.scale
    line = np.stack([1 - f, f], -1)
    weights = 0.3 * np.einsum("ya,xb->yxab", line, line).reshape(grid.scale, grid.scale, 4, 1)
    return np.broadcast_to(weights, (grid.scale, grid.scale, 4, grid.channels))


def neighbours(latents):
    """[4, rows, columns, channels]."""
    right, below = np.roll(latents, -1, 1), np.roll(latents, -1, 0)
    return np.stack([latents, right, below, np.roll(right, -1, 0)])


def features(latents, taps):
    """[rows * scale, columns * scale, channels] of latents [rows, columns, channels]."""
    rows, columns, channels = latents.shape
    scale = len(taps)
    values = np.einsum("kijc,yxkc->iyjxc", neighbours(latents), taps)
    return values.reshape(rows * scale, columns * scale, channels)


def features_adjoint(latents, taps, gradient):
    """Gradients to the latents and to the taps, from that to the features."""
    rows, columns, channels = latents.shape
    scale = len(taps)
    gradient = gradient.reshape(rows, scale, columns, scale, channels)
    to_taps = np.einsum("kijc,iyjxc->yxkc", neighbours(latents), gradient)
    each = np.einsum("iyjxc,yxkc->kijc", gradient, taps)
    to_latents = each[0] + np.roll(each[1], 1, 1) + np.roll(each[2], 1, 0) + np.roll(each[3], (1, 1), (0, 1))
    return to_latents, to_taps


def inputs(spec, latents, tensors, mip):
    """[texels, n_in] of a level in whole cells of the coarsest grid."""
    parts = [features(np.float64(latents[g]), taps_of(grid, tensors, g)) for g, grid in enumerate(spec.grids)]
    x = np.concatenate(parts, -1)
    if spec.mips > 1:
        x = np.concatenate([x, np.full((*x.shape[:2], 1), mip / 8)], -1)
    return x


def decode(spec, latents, tensors, mip):
    """[height, width, channels] of one level. latents: of its grids. tensors: float64, by name."""
    x = inputs(spec, latents, tensors, mip)
    count = len(spec.layers)
    weights, biases = ([tensors[f"{name}_{l}"] for l in range(count)] for name in ("weights", "biases"))
    activations = [networks.ACTIVATIONS["elu"]] * (count - 1) + [networks.ACTIVATIONS["linear"]]
    height, width = spec.size(mip)
    y = networks.mlp(weights, biases, activations, x.reshape(-1, spec.n_in))
    return y.reshape(*x.shape[:2], -1)[:height, :width]


def laplace_bits(q, sigma):
    """Of the mass between q - 1/2 and q + 1/2."""

    def cumulative(x):
        return np.where(x < 0, 0.5 * np.exp(np.minimum(x, 0) / sigma), 1 - 0.5 * np.exp(-np.maximum(x, 0) / sigma))

    d = np.abs(q)
    outside = 0.5 * np.exp(-(d - 0.5) / sigma) * -np.expm1(-1 / sigma)
    mass = np.where(d < 0.5, cumulative(d + 0.5) - cumulative(d - 0.5), outside)
    return -np.log2(mass + 2.0**-24)
