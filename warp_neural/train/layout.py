"""Where the parameters of a network lie in the buffers of the fused training kernels, as index arrays."""

import numpy as np

from warp_neural.kernels.coopvec.layout import bias_is_half, network_layout
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.schedule import Hopper64Layer
from warp_neural.kernels.training.hopper128.schedule import Hopper128Layer
from warp_neural.kernels.training.mma.schedule import MmaLayer, MmaSchedule
from warp_neural.kernels.training.schedule import Schedule


def fragment_order(schedule: Schedule) -> np.ndarray:
    """Of each float of a block's gradient, the index of its parameter in `MLP.master`, -1 for padding. [floats]"""
    order = np.full(schedule.floats, -1, np.int32)
    for layer in schedule.layers:
        layout = layer.layout
        n, k = accumulators(layer) if isinstance(schedule, MmaSchedule) else hopper_accumulators(layer)
        index = np.where((n < layout.n) & (k < layout.k), layout.master + n * layout.k + k, -1)
        order[layer.first : layer.bias_first] = index
        biases = layout.master + layout.n * layout.k + np.arange(layout.n)
        order[layer.bias_first : layer.bias_first + layout.n] = biases
    return order


def accumulators(layer: MmaLayer) -> tuple[np.ndarray, np.ndarray]:
    """Neuron n and input k of each float of a layer's weights."""
    i = np.arange(layer.bias_first - layer.first)
    # of m16n8: lane 4 (n % 8) + k % 8 / 2 holds rows n, n + 8 and columns k, k + 1
    register, lane, tile = i % 4, i // 4 % 32, i // 128
    n = tile // (2 * layer.k_blocks) * 16 + register // 2 * 8 + lane // 4
    k = tile % (2 * layer.k_blocks) * 8 + lane % 4 * 2 + register % 2
    return n, k


def hopper_accumulators(layer: Hopper64Layer | Hopper128Layer) -> tuple[np.ndarray, np.ndarray]:
    """The same of a schedule for warpgroups."""
    i = np.arange(layer.bias_first - layer.first)
    # of m64nN: warp w, lane 4 g + t hold rows 16 w + g, 8 more, and columns 8 j + 2 t, 1 more
    part, register = np.divmod(i // 128, layer.registers)
    row = part * 64 + i // 32 % 4 * 16 + register // 2 % 2 * 8 + i % 32 // 4
    column = register // 4 * 8 + i % 4 * 2 + register % 2
    return (column, row) if layer.last else (row, column)


def packed_targets(spec: NetworkSpec) -> np.ndarray:
    """Of each parameter, where it lies in `MLP.packed` on CUDA, in 16-bit elements; ~word for a float32 bias.

    The inverse of the order that `kernels.coopvec.layout` describes, for 16-bit formats.
    """
    targets = []
    for layer in network_layout(spec, True)[0]:
        n, k = np.divmod(np.arange(layer.n * layer.k), layer.k)
        tile = n // 8 * layer.k_pairs(spec.format) + k // 32
        word = (tile * 32 + n % 8 * 4 + k % 8 // 2) * 4 + k // 8 % 4
        targets.append((layer.weights + word) * 2 + k % 2)
        n = np.arange(layer.n)
        if bias_is_half(spec, True):
            targets.append((layer.bias + n // 32 * 16 + n % 8 // 2 * 4 + n // 8 % 4) * 2 + n % 2)
        else:
            targets.append(~(layer.bias + n // 16 * 16 + n % 8 // 2 * 4 + n // 8 % 2 * 2 + n % 2))
    return np.concatenate(targets).astype(np.int32)
