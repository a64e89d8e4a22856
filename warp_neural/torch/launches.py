"""Warp's kernels on PyTorch's memory: no copies, on PyTorch's current stream."""

from functools import cache
from typing import Any

import torch
import warp as wp

from warp_neural.kernels.coopvec.layout import bias_is_half, layer_table, make_pack_kernel, network_layout
from warp_neural.kernels.coopvec.network import make_network
from warp_neural.kernels.coopvec.rows import BLOCK, make_adjoint_kernel, make_evaluate_kernel, make_of_row
from warp_neural.kernels.nn.encodings.base import make_encode_gradient
from warp_neural.kernels.nn.encodings.network import make_encoded
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters, round_up
from warp_neural.torch.shape import Shape


@cache
def forward_kernel(shape: Shape) -> wp.Kernel:
    vec_in = wp.types.vector(shape.n_in, float)
    encode = shape.encoding.make(shape.n_in, shape.encoding_start) if shape.encoding else None
    network = make_network(shape.spec) if shape.spec else None
    func = make_encoded(network, encode) if network and encode else network or encode
    return make_evaluate_kernel(make_of_row(func, vec_in), wp.types.vector(shape.n_out, float))


@cache
def backward_kernel(shape: Shape) -> wp.Kernel:
    network = make_network(shape.spec).adjoint if shape.spec else None
    if not shape.encoding:
        return make_adjoint_kernel(network, None, None)
    encode = shape.encoding.make(shape.n_in, shape.encoding_start)
    return make_adjoint_kernel(network, encode, make_encode_gradient(shape.encoding, shape.n_in, shape.encoding_start))


@cache
def packing(spec: NetworkSpec, alias: str) -> tuple[wp.Kernel, list[wp.array], int]:
    """The kernel, the constant arrays that it reads, and the words that it writes, on the device of that name."""
    device = wp.get_device(alias)
    kernel = make_pack_kernel(spec.format, device.is_cuda, bias_is_half(spec, device.is_cuda))
    table = wp.array(layer_table(spec, device.is_cuda), dtype=int, device=device)
    steps = wp.ones((1, len(spec.layers), 2), dtype=float, device=device)  # of int8 alone
    return kernel, [table, steps], network_layout(spec, device.is_cuda)[1]


def place(tensor: torch.Tensor) -> tuple[wp.Device, wp.Stream | None]:
    """The tensor's device, and PyTorch's current stream there, where launches go."""
    if tensor.device.type == "cpu":
        return wp.get_device("cpu"), None
    stream = wp.stream_from_torch(torch.cuda.current_stream(tensor.device))
    return stream.device, stream


def evaluate(shape: Shape, x: torch.Tensor, params: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """x: float32 [n, n_in] of any strides. Results, float32 [n, n_out], and the packed network for `adjoint`."""
    y = torch.empty((len(x), shape.n_out), dtype=torch.float32, device=x.device)
    where = place(x)
    packed = pack(shape, params, where)
    if len(x):
        inputs = [_parameters(params, packed), _argument(x), _argument(y)]
        _launch(forward_kernel(shape), round_up(len(x), BLOCK), inputs, where)
    return y, packed


def pack(shape: Shape, params: torch.Tensor, where: tuple[wp.Device, wp.Stream | None]) -> torch.Tensor:
    """The network's parameters as its kernels read them, in memory of its own: each evaluation keeps the one it had."""
    if not shape.spec:
        return torch.empty(0, dtype=torch.int32, device=params.device)
    kernel, constants, words = packing(shape.spec, where[0].alias)
    packed = torch.empty(words, dtype=torch.int32, device=params.device)
    inputs = [*constants, _argument(params), shape.spec.n_parameters, _argument(packed, wp.uint32), words]
    _launch(kernel, (1, words), inputs, where)
    return packed


def adjoint(
    shape: Shape,
    x: torch.Tensor,
    params: torch.Tensor,
    packed: torch.Tensor,
    dy: torch.Tensor,
    needs: tuple[bool, bool],
) -> tuple[torch.Tensor | None, torch.Tensor | None]:
    """dy: float32 [n, n_out]. The gradients in x and params, those of them that are needed; biases not masked."""
    dx = torch.empty((len(x), shape.n_in), dtype=torch.float32, device=x.device) if needs[0] else None
    dparams = torch.zeros_like(params) if needs[1] else None
    if len(x):
        to = x.new_empty((0, shape.n_in)) if dx is None else dx
        inputs = [_parameters(params, packed, dparams), _argument(x), _argument(dy), _argument(to)]
        _launch(backward_kernel(shape), round_up(len(x), BLOCK), inputs, place(x))
    return dx, dparams


def _parameters(params: torch.Tensor, packed: torch.Tensor, gradient: torch.Tensor | None = None) -> Parameters:
    result = Parameters()
    result.packed = _array(packed, wp.uint32)
    result.master = _array(params, gradient=gradient)
    result.network, result.count, result.kind = 0, 1, 0
    return result


def _array(tensor: torch.Tensor, dtype: type = wp.float32, gradient: torch.Tensor | None = None) -> wp.array:
    return wp.from_torch(tensor, dtype, requires_grad=gradient is not None, grad=gradient)


def _argument(tensor: torch.Tensor, dtype: type = wp.float32) -> Any:
    """Of a launch: what Warp makes of an array in the end."""
    return wp.from_torch(tensor, dtype, requires_grad=False, return_ctype=True)


def _launch(kernel: wp.Kernel, dim: int | tuple[int, int], inputs: list, where: tuple) -> None:
    device, stream = where
    wp.launch(kernel, dim, inputs, device=device, stream=stream, block_dim=BLOCK, record_tape=False)
