"""`TensorDecoder`: decoding by tensor cores, and what its kernel reads, see `kernels.texture.tensor_layout`."""

from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.texture.spec import DETAIL_SCALE, TextureSpec
from warp_neural.kernels.texture.tensor_cores import (
    BLOCK,
    make_table_kernel,
    make_tensor_decode_kernel,
    tensor_dim,
)
from warp_neural.kernels.texture.tensor_layout import TensorLayout
from warp_neural.nn.mlp import MLP

LOG2E = 1 / np.log(2)


def can_decode(spec: TextureSpec, device: wp.Device) -> bool:
    return device.is_cuda and device.arch >= 80 and TensorLayout(spec).fits


class TensorDecoder:
    """Of a texture's parameters and its network."""

    def __init__(self, spec: TextureSpec, params_type: Any, params: Any, net: MLP):
        self.layout, self.params_type, self.params, self.device = TensorLayout(spec), params_type, params, net.device
        self.tables = wp.zeros(8 * self.layout.tables[-1], dtype=wp.float16, device=self.device)
        for g, grid in enumerate(spec.grids):
            dim = grid.scale, grid.scale, 8 * self.layout.slabs[g]
            wp.launch(make_table_kernel(spec, g), dim, [params.kernels, self.tables], device=self.device)
        layers = network_layers(net)
        weights = np.concatenate([dealt(padded(self.layout, l, w)) for l, (w, _) in enumerate(layers)])
        biases = np.concatenate([biases_of_mips(self.layout, l, w, b) for l, (w, b) in enumerate(layers)], 1)
        self.weights = wp.array(weights.astype(np.float16).view(np.uint32), dtype=wp.uint32, device=self.device)
        self.biases = wp.array(biases.ravel(), dtype=float, device=self.device)

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


def dealt(matrix: np.ndarray) -> np.ndarray:
    """Padded weights in the order of lanes: 16 inputs, 16 outputs, g, t, tile, half, column."""
    return matrix.reshape(-1, 2, 8, matrix.shape[1] // 16, 2, 4, 2).transpose(3, 0, 2, 5, 1, 4, 6).ravel()


def biases_of_mips(layout: TensorLayout, l: int, w: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[mips, padded outputs], with the level of detail."""
    values = np.zeros((layout.spec.mips, layout.sizes[l + 1]))
    values[:, : len(b)] = b
    if l == 0 and layout.spec.mips > 1:
        values[:, : len(b)] += np.arange(layout.spec.mips)[:, None] / DETAIL_SCALE * w[:, -1]
    return values
