"""Networks between PyTorch and Warp, with one vector of parameters."""

from dataclasses import replace

import numpy as np
import torch
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.nn.spec import FLOAT16, INT8
from warp_neural.nn.mlp import MLP
from warp_neural.nn.state import NetworkState
from warp_neural.torch.modules import Module
from warp_neural.torch.order import Order
from warp_neural.torch.shape import Shape


def to_warp(module: Module) -> MLP:
    """`Module.to_warp`."""
    shape = module.shape
    if shape.spec is None:
        raise InputError("to_warp: an encoding without a network; use wn.encodings, or a NetworkWithInputEncoding")
    if module.params.dtype is not torch.float32:
        raise InputError(f"to_warp: parameters of {module.params.dtype}; call .float() first")
    empty = NetworkState(shape.spec, np.zeros(shape.spec.n_parameters), encoding=shape.encoding, n_in=shape.n_in)
    net = MLP.from_state(empty, device=wp.device_from_torch(module.params.device))
    net.share(wp.from_torch(module.params.detach(), requires_grad=False))
    return net


def from_warp(net: MLP) -> Module:
    """The module of a network, with the parameters in the network's memory; biases are trained.

    Outputs are float16 if the network computes so, else float32. After the parameters have changed here, call
    `net.pack()` before kernels use it. Raises `InputError` for several networks, and for int8.
    """
    if net.count > 1:
        raise InputError(f"from_warp: {net.count} networks; a module has one: make an MLP of its state alone")
    if net.spec.format is INT8:
        raise InputError("from_warp: int8 networks are trained by wn.Trainer; make the MLP of another precision")
    shape = Shape(net.n_in, net.encoding, replace(net.spec, dtype=wp.float32), (True,) * len(net.spec.layers))
    dtype = torch.float16 if net.spec.format is FLOAT16 else torch.float32
    return Module(shape, Order(shape), dtype, 0, wp.to_torch(net.master, requires_grad=False))
