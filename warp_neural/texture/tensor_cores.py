"""`TensorDecoder`: what the tensor-core kernel of whole pictures reads, see `kernels.texture.tensor_cores`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.texture.tensor_cores import (
    BLOCK,
    TensorLayout,
    make_table_kernel,
    make_tensor_decode_kernel,
    tensor_dim,
)
from warp_neural.nn.mlp import MLP

LOG2E = 1 / np.log(2)


def can_decode(spec: TextureSpec, device: wp.Device) -> bool:
    return device.is_cuda and device.arch >= 80 and TensorLayout(spec).fits


class TensorDecoder:
    """Of a texture's parameters and its network."""

    def __init__(self, spec: TextureSpec, params_type: Any, params: Any, net: MLP):
        self.spec, self.params_type, self.params, self.layout = spec, params_type, params, TensorLayout(spec)
        self.device = net.device
        self.tables = wp.zeros(8 * self.layout.tables[-1], dtype=wp.float16, device=self.device)
        for g, grid in enumerate(spec.grids):
            dim = grid.scale, grid.scale, 8 * self.layout.slabs[g]
            wp.launch(make_table_kernel(spec, g), dim, [params.kernels, self.tables], device=self.device)
        packed = packed_weights(self.layout, net.weights).view(np.uint32)
        self.weights = wp.array(packed, dtype=wp.uint32, device=self.device)
        self.biases = wp.array(padded_biases(self.layout, net.weights, net.biases), dtype=float, device=self.device)

    def decode(self, mip: int, rectangle: tuple[int, int, int, int], values: wp.array) -> None:
        """rectangle: left, top, width, height. values: see `make_tensor_decode_kernel`."""
        kernel = make_tensor_decode_kernel(self.spec, self.params_type, values.dtype)
        inputs = [self.params, self.tables.view(wp.uint32), self.weights, self.biases, mip, rectangle, values]
        wp.launch(kernel, tensor_dim(*rectangle), inputs, device=self.device, block_dim=BLOCK, record_tape=False)


def columns_of(layout: TensorLayout) -> np.ndarray:
    """Of the inputs of all grids, where they are in padded ones."""
    starts = 8 * np.cumsum([0, *layout.slabs])
    return np.concatenate([np.arange(grid.channels) + a for grid, a in zip(layout.spec.grids, starts, strict=False)])


def packed_weights(layout: TensorLayout, weights: Sequence[np.ndarray]) -> np.ndarray:
    """float16, in the order of `kernels.texture.tensor_cores`."""
    parts, last = [], len(weights) - 1
    for l, matrix in enumerate(weights):
        padded = np.zeros((layout.sizes[l + 1], layout.sizes[l]), np.float32)
        columns = columns_of(layout) if l == 0 else np.arange(matrix.shape[1])
        padded[: len(matrix), columns] = matrix[:, : len(columns)]
        padded *= (LOG2E if l < last else 1) / (LOG2E if l > 0 else 1)
        by_lane = padded.reshape(-1, 2, 8, layout.sizes[l] // 16, 2, 4, 2)  # pairs, tile, g, blocks, half, t, k
        parts.append(by_lane.transpose(3, 0, 2, 5, 1, 4, 6).ravel())
    return np.concatenate(parts).astype(np.float16)


def padded_biases(layout: TensorLayout, weights: Sequence[np.ndarray], biases: Sequence[np.ndarray]) -> np.ndarray:
    """float32, in the order of `kernels.texture.tensor_cores`."""
    values = np.zeros((layout.spec.mips, 2 * layout.biases[-1]), np.float32)
    for start, bias in zip(layout.biases, biases, strict=False):
        values[:, 2 * start : 2 * start + len(bias)] = bias
    if layout.spec.mips > 1:
        detail = np.arange(layout.spec.mips)[:, None] / 8  # as `make_levels` has it
        values[:, : len(biases[0])] += detail * weights[0][:, -1]
    values[:, : 2 * layout.biases[-2]] *= LOG2E
    return np.tile(values.reshape(-1, 1, 2), (1, 2, 1)).ravel()
