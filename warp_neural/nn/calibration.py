"""INT8 networks: the launches that set the steps of a layer's inputs, and of its weights."""

from typing import TYPE_CHECKING

import warp as wp

from warp_neural.kernels.nn.calibration import (
    INPUTS,
    WEIGHTS,
    finish_kernel,
    make_layer_kernel,
    make_take_kernel,
    start_kernel,
    weights_kernel,
)
from warp_neural.kernels.nn.encodings.network import make_encode_kernel

if TYPE_CHECKING:
    from warp_neural.nn.mlp import MLP


class Calibration:
    """Sets the steps of `net` from as many samples, then packs; a CUDA graph can hold it."""

    def __init__(self, net: "MLP", samples: int):
        self.net, sizes = net, [net.n_in, *net.spec.sizes] if net.encoding else net.spec.sizes
        self.h = [wp.empty((net.count, samples, n), dtype=float, device=net.device) for n in sizes]

    def run(self, x: wp.array, keep: float = 0.0) -> None:
        """x: [samples, n_in]. keep: of each step so far; the result is no smaller than that."""
        net, (h, *results) = self.net, self.h
        spec, which = net.spec, (net.count, len(net.spec.layers))
        _launch(net, start_kernel, which, net.steps, INPUTS, keep)
        _launch(net, make_take_kernel(x.dtype), h.shape, x, h)
        if net.encoding:
            h, *results = results
            _launch(net, make_encode_kernel(net.plain_encode), h.shape[:2], net.plain, self.h[0], h)
        for layer, y in enumerate(results):
            parameters = net.master, spec.n_parameters, spec.offsets[layer], layer
            _launch(net, make_layer_kernel(spec.activation_of(layer)), y.shape, *parameters, h, net.steps, y)
            h = y
        _launch(net, finish_kernel, which, net.steps, INPUTS)
        net.pack()


def set_weight_steps(net: "MLP") -> None:
    """Those of the weights as they are now."""
    spec, which = net.spec, (net.count, len(net.spec.layers))
    _launch(net, start_kernel, which, net.steps, WEIGHTS, 0.0)
    for layer, (k, n) in enumerate(spec.layers):
        parameters = net.master, spec.n_parameters, spec.offsets[layer], layer
        _launch(net, weights_kernel, (net.count, n * k), *parameters, net.steps)
    _launch(net, finish_kernel, which, net.steps, WEIGHTS)


def _launch(net: "MLP", kernel: wp.Kernel, dim: tuple[int, ...], *inputs) -> None:
    wp.launch(kernel, dim, inputs, device=net.device, record_tape=False)
