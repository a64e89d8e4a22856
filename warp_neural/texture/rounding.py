"""From trained numbers to the integers of the file."""

import numpy as np

from warp_neural.kernels.texture.layout import Layout
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.nn.mlp import MLP
from warp_neural.texture.levels import split_latents
from warp_neural.texture.state import Tensor

BIASES = 1024.0  # their steps: rms / BIASES; at 64 the mean of a channel was off by up to 1.6 / 255


def step_of(values: np.ndarray, precision: float) -> np.float32:
    """rms / precision, a float16 number."""
    rms = np.sqrt(np.mean(np.square(values, dtype=np.float64)))
    return np.float32(np.float16(max(rms, 1e-3) / precision))


def kernel_steps(layout: Layout, values: np.ndarray, precision: float) -> np.ndarray:
    """Of each number of `layout`; 1 of those that the file does not hold."""
    steps = np.ones(layout.size, np.float32)
    for name, place in layout.places.items():
        if name.startswith("kernel"):
            steps[place.start : place.end] = step_of(values[place.start : place.end], precision)
    return steps


def network_steps(net: MLP, precision: float) -> np.ndarray:
    """Of each number of `net.master`."""
    parts = []
    for w, b in zip(net.weights, net.biases, strict=True):
        parts += [np.full(w.size, step_of(w, precision)), np.full(b.size, step_of(b, BIASES))]
    return np.concatenate(parts).astype(np.float32)


def tensors_of(
    layout: Layout, kernels: np.ndarray, steps: np.ndarray, net: MLP, steps_of_net: np.ndarray
) -> dict[str, Tensor]:
    """By the names of `TextureSpec.tensors`."""
    tensors = {}
    for name, place in layout.places.items():
        if name.startswith("kernel"):
            values = np.moveaxis(kernels[place.start : place.end].reshape(place.shape), -1, 0)
            tensors[name] = integers(values, steps[place.start])
    return tensors | network_tensors(net, steps_of_net)


def network_tensors(net: MLP, steps_of_net: np.ndarray) -> dict[str, Tensor]:
    tensors, at = {}, 0
    for l, (w, b) in enumerate(zip(net.weights, net.biases, strict=True)):
        tensors[f"weights_{l}"] = integers(w, steps_of_net[at])
        tensors[f"biases_{l}"] = integers(b, steps_of_net[at + w.size])
        at += w.size + b.size
    return tensors


def integers(values: np.ndarray, step: np.float32) -> Tensor:
    return Tensor(np.rint(values / step).astype(np.int32), float(step))


def rounded_latents(spec: TextureSpec, flat: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    """int8 [rows, columns, channels] of each mip and grid."""
    levels = split_latents(spec, flat)
    return tuple(tuple(_rounded(x, grid) for x, grid in zip(level, spec.grids, strict=True)) for level in levels)


def _rounded(latents: np.ndarray, grid: Grid) -> np.ndarray:
    if grid.bits == 1:
        return np.where(latents < 0, -1, 1).astype(np.int8)
    return np.clip(np.rint(latents), -grid.limit, grid.limit).astype(np.int8)
