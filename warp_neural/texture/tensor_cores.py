"""`TensorDecoder`: decoding by tensor cores, and what its kernel reads, see `kernels.texture.tensor_layout`."""

from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.texture.tensor_cores import (
    BLOCK,
    make_inputs_kernel,
    make_table_kernel,
    make_tensor_decode_kernel,
    tensor_dim,
)
from warp_neural.kernels.texture.tensor_layout import Precision, TensorLayout
from warp_neural.nn.mlp import MLP

LOG2E = 1 / np.log(2)
SAMPLES = 2**16  # texels that say what ranges bytes are for
RIDGE = 1e-3
MARGIN = 0.03  # of a range, beyond both ends: other texels than the samples


def can_decode(spec: TextureSpec, device: wp.Device) -> bool:
    return device.is_cuda and device.arch >= 80 and TensorLayout(spec).fits


class TensorDecoder:
    """Of a texture's parameters and its network. precision: of the vectors between layers and of weights."""

    def __init__(self, spec: TextureSpec, params_type: Any, params: Any, net: MLP, precision: Precision = "float16"):
        self.layout, self.params_type, self.params, self.device = (
            TensorLayout(spec, precision),
            params_type,
            params,
            net.device,
        )
        layers = network_layers(net)
        if precision == "int8":
            weights, biases, ranges = byte_layers(self.layout, layers, sample_inputs(spec, params_type, params))
        else:
            weights, biases, ranges = half_layers(self.layout, layers)
        start = 8 * self.layout.tables[-1]
        self.tables = wp.zeros(start + ranges.size, dtype=wp.float16, device=self.device)
        if ranges.size:
            self.tables[start:].assign(ranges)
        for g, grid in enumerate(spec.grids):
            dim = grid.scale, grid.scale, 8 * self.layout.slabs[g]
            wp.launch(make_table_kernel(spec, g), dim, [params.kernels, self.tables], device=self.device)
        self.weights = wp.array(weights.view(np.uint32), dtype=wp.uint32, device=self.device)
        self.biases = wp.array(biases, dtype=float, device=self.device)

    def decode(self, mip: int, rectangle: tuple[int, int, int, int], values: wp.array) -> None:
        """rectangle: left, top, width, height. values: see `make_tensor_decode_kernel`."""
        kernel = make_tensor_decode_kernel(self.layout, self.params_type, values.dtype)
        inputs = [self.params, self.tables, self.weights, self.biases, mip, rectangle, values]
        wp.launch(kernel, tensor_dim(*rectangle), inputs, device=self.device, block_dim=BLOCK, record_tape=False)


def network_layers(net: MLP) -> list[tuple[np.ndarray, np.ndarray]]:
    """float64 weights and biases, for vectors between layers that are log2 e times what they are."""
    layers, last = [], len(net.weights) - 1
    for l, (w, b) in enumerate(zip(net.weights, net.biases, strict=True)):
        out = LOG2E if l < last else 1.0
        layers.append((np.float64(w) * out / (LOG2E if l > 0 else 1.0), np.float64(b) * out))
    return layers


def columns_of(layout: TensorLayout) -> np.ndarray:
    """Of the inputs of all grids, where they are in padded ones."""
    starts = 8 * np.cumsum([0, *layout.slabs])
    return np.concatenate([np.arange(grid.channels) + a for grid, a in zip(layout.spec.grids, starts, strict=False)])


def padded(layout: TensorLayout, l: int, matrix: np.ndarray) -> np.ndarray:
    """[padded outputs, padded inputs] of layer l; the level of detail is left out."""
    values = np.zeros((layout.sizes[l + 1], layout.sizes[l]))
    columns = columns_of(layout) if l == 0 else np.arange(matrix.shape[1])
    values[: len(matrix), columns] = matrix[:, : len(columns)]
    return values


def dealt(layout: TensorLayout, matrix: np.ndarray) -> np.ndarray:
    """Padded weights in the order of lanes."""
    blocks = matrix.shape[1] // layout.step
    if layout.precision == "int8":  # pairs, tile, g, blocks, half, slab of it, t, column
        return matrix.reshape(-1, 2, 8, blocks, 2, 2, 4, 2).transpose(3, 0, 2, 6, 1, 4, 5, 7).ravel()
    return matrix.reshape(-1, 2, 8, blocks, 2, 4, 2).transpose(3, 0, 2, 5, 1, 4, 6).ravel()  # ..., half, t, column


def biases_of_mips(layout: TensorLayout, l: int, w: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[mips, padded outputs], with the level of detail."""
    values = np.zeros((layout.spec.mips, layout.sizes[l + 1]))
    values[:, : len(b)] = b
    if l == 0 and layout.spec.mips > 1:
        values[:, : len(b)] += np.arange(layout.spec.mips)[:, None] / 8 * w[:, -1]  # as `make_levels` has it
    return values


def half_layers(layout: TensorLayout, layers: list) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights, biases and no ranges."""
    weights = [dealt(layout, padded(layout, l, w)) for l, (w, _) in enumerate(layers)]
    biases = [biases_of_mips(layout, l, w, b) for l, (w, b) in enumerate(layers)]
    biases = np.concatenate(biases, 1).reshape(-1, 1, 2).repeat(2, 1)
    return np.concatenate(weights).astype(np.float16), biases.astype(np.float32).ravel(), np.zeros(0, np.float16)


def byte_layers(layout: TensorLayout, layers: list, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights, terms and ranges. x: of some texels, [n, n_in], what ranges are for.

    Each output has a step of its weights, each input a range. Weights and biases are refitted by least squares to what
    the exact network gives of these texels, from the inputs that bytes hold.
    """
    weights, terms, ranges, rounded = [], [], [], x
    for l, (w, b) in enumerate(layers):
        scale, offset = ranges_of(x)
        codes = np.rint(255 * np.clip(rounded * scale + offset, 0, 1))
        z = x @ w.T + b
        w, b = refitted((codes / 255 - offset) / scale, z, w, b)
        by_code = padded(layout, l, w / (255 * scale))
        step = np.float32(np.maximum(np.abs(by_code).max(1), 1e-12) / 127).astype(np.float64)
        by_code = np.rint(by_code / step[:, None])
        weights.append(dealt(layout, by_code))
        pairs = np.stack([padded(layout, l, each[None])[0] for each in (scale, offset)])  # [2, padded inputs]
        ranges.append(pairs.reshape(2, -1, 2).transpose(1, 0, 2))
        start = biases_of_mips(layout, l, w, b) - step * (by_code @ (255 * pairs[1]) + 1.5 * 2**23)
        both = (np.broadcast_to(each, start.shape).reshape(len(start), -1, 2) for each in (step, start))
        terms.append(np.stack([*both], 2))
        x, rounded = activated(z), activated((codes / 255 - offset) / scale @ w.T + b)
    ranges = np.concatenate(ranges).astype(np.float16).ravel()
    return np.concatenate(weights).astype(np.int8), np.concatenate(terms, 1).astype(np.float32).ravel(), ranges


def ranges_of(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """a and b of each column, float16 numbers: a v + b is 0 to 1."""
    low, high = x.min(0), x.max(0)
    low, high = low - MARGIN * (high - low), high + MARGIN * (high - low)
    scale = np.float16(1 / np.maximum(high - low, 1e-3)).astype(np.float64)
    return scale, np.float16(-low * scale).astype(np.float64)


def refitted(x: np.ndarray, z: np.ndarray, w: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares of w x + b - z, with a little weight on staying near w and b."""
    ones = np.concatenate([x, np.ones((len(x), 1))], 1)
    squares = ones.T @ ones
    change = np.linalg.solve(squares + RIDGE * np.diag(np.diag(squares) + 1e-6), ones.T @ (z - x @ w.T - b))
    return w + change[:-1].T, b + change[-1]


def activated(z: np.ndarray) -> np.ndarray:
    """ELU times log2 e, of z log2 e."""
    return np.where(z > 0, z, (np.exp2(np.minimum(z, 0)) - 1) * LOG2E)


def sample_inputs(spec: TextureSpec, params_type: Any, params: Any) -> np.ndarray:
    """The network's inputs at all texels of all levels, or at some, float64 [n, n_in]."""
    sizes, device = np.array([spec.size(mip) for mip in range(spec.mips)]), params.latents.device
    ends = np.cumsum(sizes.prod(1))
    texels = np.arange(ends[-1]) if ends[-1] <= SAMPLES else np.random.default_rng(0).integers(0, ends[-1], SAMPLES)
    mips = np.searchsorted(ends, texels, "right")
    rows, columns = np.divmod(texels - (ends - sizes.prod(1))[mips], sizes[mips, 1])
    places = wp.array(np.stack([mips, rows, columns], 1), dtype=wp.vec3i, device=device)
    values = wp.empty((len(mips), spec.n_in), dtype=float, device=device)
    wp.launch(make_inputs_kernel(spec, params_type), len(mips), [params, places, values], device=device)
    return values.numpy().astype(np.float64)
