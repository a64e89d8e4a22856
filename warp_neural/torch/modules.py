"""`Network`, `Encoding`, `NetworkWithInputEncoding`: tiny-cuda-nn's modules."""

from typing import Any

import numpy as np
import torch

from warp_neural.errors import InputError
from warp_neural.kernels.errors import LARGEST_SEED, require_whole
from warp_neural.kernels.nn.encodings import Encoding as WarpEncoding
from warp_neural.kernels.nn.spec import round_up
from warp_neural.nn.mlp import MLP
from warp_neural.torch.encodings import make_encoding, pads_in_front, pads_with_zeros
from warp_neural.torch.gradients import Evaluate
from warp_neural.torch.networks import read_network
from warp_neural.torch.order import PADDED, Order
from warp_neural.torch.shape import Shape

LOSS_SCALE = {torch.float16: 128.0, torch.float32: 1.0}  # tiny-cuda-nn's


class Module(torch.nn.Module):
    """What the modules share.

    params: all trainable numbers, one float32 vector in the order of `wn.MLP.master`, not tiny-cuda-nn's: see
    `load_tcnn_params`. dtype: of the outputs, and what networks compute in; float16 unless given. seed: of the initial
    parameters, which are tiny-cuda-nn's. loss_scale: gradients are multiplied by it inside a float16 network, and
    divided by it before anyone sees them. jit_fusion: taken and without effect, as everything is compiled at run time.

    Biases: tiny-cuda-nn has none, but fills a network's inputs to a multiple of 16 with ones, which act as a bias of
    the first layer; here they are one. The other layers have biases with `"biases": true` in the network's
    configuration; without, those in `params` stay 0.

    Second and further derivatives (`create_graph=True`), as of an eikonal loss, are PyTorch's own of the same function
    in float32: slower than first ones. tiny-cuda-nn has second ones of grids alone.
    """

    def __init__(self, shape: Shape, order: Order, dtype: torch.dtype | None, seed: int, params: torch.Tensor | None):
        super().__init__()
        dtype = torch.float16 if dtype is None else dtype
        if dtype not in LOSS_SCALE:
            raise InputError(f"dtype={dtype}: expected torch.float16 or torch.float32")
        require_whole("seed", seed, 0, LARGEST_SEED)
        self.shape, self.order, self.dtype, self.seed = shape, order, dtype, seed
        self.n_input_dims, self.n_output_dims = shape.n_in, shape.n_out
        self.loss_scale, self.jit_fusion = LOSS_SCALE[dtype], False
        params = torch.from_numpy(order.take(order.initial(seed))) if params is None else params
        self.params = torch.nn.Parameter(params)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """x: [..., n_input_dims] of any floating type and strides, on the parameters' device. [..., n_output_dims]."""
        if not isinstance(x, torch.Tensor) or not x.shape or x.shape[-1] != self.n_input_dims:
            found = list(x.shape) if isinstance(x, torch.Tensor) else type(x).__name__
            raise InputError(f"inputs {found}: expected a tensor [n, {self.n_input_dims}]")
        if x.device != self.params.device:
            raise InputError(f"inputs on {x.device}, parameters on {self.params.device}; move one with .to")
        if not x.is_floating_point():
            raise InputError(f"inputs of {x.dtype}: expected floating-point numbers")
        rows = x.reshape(-1, self.n_input_dims).float()
        rows = rows.contiguous() if 0 in rows.stride() else rows
        scale = self.loss_scale if self.shape.spec else 1.0  # encodings compute in float32
        y = Evaluate.apply(rows, self.params.float(), self.shape, scale)
        return y.to(self.dtype).reshape(*x.shape[:-1], self.n_output_dims)

    def load_tcnn_params(self, params: torch.Tensor | np.ndarray) -> None:
        """Take the parameters of tiny-cuda-nn's module of the same configuration, its `params` as it stands.

        Networks first, each matrix [out, in] row major and padded to multiples of 16, then encodings. What has no
        effect is left out; the columns of inputs that are always one become the first bias. After spherical harmonics
        these columns come first, as tiny-cuda-nn has it without run-time fusion. Raises `InputError` for other sizes.
        """
        vector = params.detach().cpu().numpy() if isinstance(params, torch.Tensor) else np.asarray(params)
        with torch.no_grad():
            self.params.copy_(torch.from_numpy(self.order.take(vector)))

    def tcnn_params(self) -> torch.Tensor:
        """The parameters as tiny-cuda-nn's module takes them, float32 on the CPU.

        Raises `InputError` if a bias that tiny-cuda-nn has not is not 0.
        """
        return torch.from_numpy(self.order.give(self.params.detach().cpu().float().numpy()))

    def to_warp(self) -> MLP:
        """The network as one that any Warp kernel can call, with the parameters in this module's memory.

        After the parameters have changed here, call its `pack()`; they part if this module moves to another device.
        Raises `InputError` for an encoding without a network.
        """
        from warp_neural.torch.sharing import to_warp

        return to_warp(self)

    def extra_repr(self) -> str:
        shape, sizes = self.shape, "-".join(map(str, self.shape.spec.sizes)) if self.shape.spec else ""
        return ", ".join(filter(None, [f"{shape.n_in} inputs", str(shape.encoding or ""), sizes, str(self.dtype)]))


class Network(Module):
    """`n_input_dims` -> `n_output_dims`."""

    def __init__(
        self,
        n_input_dims: int,
        n_output_dims: int,
        network_config: dict,
        seed: int = 1337,
        dtype: torch.dtype | None = None,
    ):
        super().__init__(*_network(n_input_dims, n_output_dims, None, network_config, dtype), dtype, seed, None)


class NetworkWithInputEncoding(Module):
    """`n_input_dims` -> encoding -> network -> `n_output_dims`."""

    def __init__(
        self,
        n_input_dims: int,
        n_output_dims: int,
        encoding_config: dict,
        network_config: dict,
        seed: int = 1337,
        dtype: torch.dtype | None = None,
    ):
        require_whole("n_input_dims", n_input_dims)
        encoding = make_encoding(encoding_config, n_input_dims)
        super().__init__(*_network(n_input_dims, n_output_dims, encoding, network_config, dtype), dtype, seed, None)


class Encoding(Module):
    """An encoding alone, whose `n_output_dims` follows from its configuration; it computes in float32."""

    def __init__(self, n_input_dims: int, encoding_config: dict, seed: int = 1337, dtype: torch.dtype | None = None):
        require_whole("n_input_dims", n_input_dims)
        shape = Shape(n_input_dims, make_encoding(encoding_config, n_input_dims), None)
        super().__init__(shape, Order(shape), dtype, seed, None)


def _network(n_in: int, n_out: int, encoding: WarpEncoding | None, config: dict, dtype: Any) -> tuple[Shape, Order]:
    require_whole("n_input_dims", n_in)
    require_whole("n_output_dims", n_out)
    options = read_network(config)
    width = encoding.n_out(n_in) if encoding else n_in
    spec = options.spec(width, n_out, dtype is not torch.float32)
    ones = not pads_with_zeros(encoding)
    first = options.biases or (ones and round_up(width, PADDED) > width)
    shape = Shape(n_in, encoding, spec, (first, *[options.biases] * options.depth))
    return shape, Order(shape, ones, pads_in_front(encoding))


def supports_jit_fusion() -> bool:
    """Kernels are always compiled at run time."""
    return True
