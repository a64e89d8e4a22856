"""Where the parameters of a network lie in the buffers of the fused training kernels, as index arrays."""

import numpy as np

from warp_neural.kernels.coopvec.layout import bias_is_half, bias_layout, network_layout
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.schedule import Schedule


def fragment_order(schedule: Schedule) -> np.ndarray:
    """Of each float of a block's gradient, the index of its parameter in `MLP.master`, -1 for padding. [floats]"""
    order = np.full(schedule.floats, -1, np.int32)
    for layer in schedule.layers:
        layout = layer.layout
        n, k = layer.weight_sums.place(np.arange(layer.weight_sums.elements))
        index = np.where((n < layout.n) & (k < layout.k), layout.master + n * layout.k + k, -1)
        order[layer.first : layer.bias_first] = index
        biases = layout.master + layout.n * layout.k + np.arange(layout.n)
        order[layer.bias_first : layer.bias_first + layout.n] = biases
    return order


def packed_targets(spec: NetworkSpec) -> np.ndarray:
    """Of each parameter, where it lies in `MLP.packed` on CUDA, in 16-bit elements; ~word for a float32 bias.

    Of 16-bit formats.
    """
    targets = []
    for layer in network_layout(spec, True)[0]:
        n, k = np.divmod(np.arange(layer.n * layer.k), layer.k)
        targets.append(2 * layer.weights + layer.operands(spec.format).index(n, k))
        bias = bias_layout(spec, layer.n_pad).index(np.arange(layer.n))
        targets.append(2 * layer.bias + bias if bias_is_half(spec, True) else ~(layer.bias + bias))
    return np.concatenate(targets).astype(np.int32)
