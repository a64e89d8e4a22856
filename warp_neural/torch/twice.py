"""Encodings and networks in PyTorch's own operations, which it can differentiate again: for second derivatives alone.

In float32, without the rounding of float16 networks, and slower than the kernels by far; memory goes with the batch
times the corners of all grids.
"""

from collections.abc import Callable
from functools import singledispatch
from itertools import product

import torch
from torch.nn import functional

from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.encodings import (
    Concatenate,
    Encoding,
    Frequency,
    HashGrid,
    Identity,
    OneBlob,
    Scaled,
    SphericalHarmonics,
    TriangleWave,
)
from warp_neural.torch.networks import sharp_softplus, sharp_squareplus
from warp_neural.torch.shape import Shape

ACTIVATIONS: dict[Activation, Callable[[torch.Tensor], torch.Tensor]] = {
    activations.linear: lambda z: z,
    activations.relu: torch.relu,
    activations.leaky_relu: lambda z: functional.leaky_relu(z, 0.01),
    activations.elu: functional.elu,
    activations.exponential: torch.exp,
    activations.shifted_exponential: lambda z: torch.exp(z - 3),
    activations.sigmoid: torch.sigmoid,
    activations.tanh: torch.tanh,
    activations.silu: functional.silu,
    activations.gelu: functional.gelu,
    activations.softplus: functional.softplus,
    activations.sine: torch.sin,
    activations.squareplus: lambda z: 0.5 * (z + torch.sqrt(z * z + 4)),
    sharp_softplus: lambda z: functional.softplus(z, beta=10),
    sharp_squareplus: lambda z: 0.5 * (z + torch.sqrt(z * z + 0.04)),
}
WORD = 0xFFFFFFFF  # indices of grids wrap as 32-bit words do


def evaluate_twice(shape: Shape, x: torch.Tensor, params: torch.Tensor) -> torch.Tensor:
    """[n, n_out] of x [n, n_in]. Raises `NotImplementedError` for what only kernels have."""
    h = encode(shape.encoding, x, params[shape.encoding_start :]) if shape.encoding else x
    if not shape.spec:
        return h
    for layer, ((k, n), start) in enumerate(zip(shape.spec.layers, shape.spec.offsets, strict=True)):
        weights, biases = params[start : start + n * k], params[start + n * k : start + n * k + n]
        activation = shape.spec.activation_of(layer)
        if activation not in ACTIVATIONS:
            raise NotImplementedError(f"no second derivatives of activation {activation.name!r}, your own")
        h = ACTIVATIONS[activation](functional.linear(h, weights.reshape(n, k), biases))
    return h


@singledispatch
def encode(encoding: Encoding, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    """[n, n_out] of inputs [n, n_in] and the encoding's parameters."""
    raise NotImplementedError(f"no second derivatives of encoding {type(encoding).__name__}")


@encode.register
def _(encoding: Identity, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    return x


@encode.register
def _(encoding: Scaled, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    return encode(encoding.encoding, encoding.scale * x + encoding.offset, own)


@encode.register
def _(encoding: Concatenate, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    leaves = encoding.leaves(x.shape[1])
    return torch.cat([encode(leaf.encoding, x[:, list(leaf.inputs)], own[leaf.parameter :]) for leaf in leaves], dim=1)


@encode.register
def _(encoding: Frequency, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    turns = x.unsqueeze(-1) * x.new_tensor(encoding.frequencies())
    angles = torch.pi * (turns - 2 * torch.round(0.5 * turns).detach())
    return torch.stack([torch.sin(angles), torch.cos(angles)], dim=-1).flatten(1)


@encode.register
def _(encoding: TriangleWave, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    k = torch.arange(encoding.octaves, device=x.device)
    turns = x.unsqueeze(-1) * (0.5 * 2.0**k) + 0.25 * (k % 4)
    return (4 * torch.abs(turns - turns.floor() - 0.5) - 1).flatten(1)


@encode.register
def _(encoding: OneBlob, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    def integral(u: torch.Tensor) -> torch.Tensor:
        u = u.clamp(-1, 1)
        return 0.5 + u * (0.9375 + u * u * (-0.625 + 0.1875 * u * u))

    u = torch.arange(encoding.bins + 1, device=x.device) - encoding.bins * x.unsqueeze(-1)
    return (integral(u) + integral(u - encoding.bins) + integral(u + encoding.bins)).diff(dim=-1).flatten(1)


@encode.register
def _(encoding: SphericalHarmonics, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    a, b, z = x.unbind(1)
    real, imaginary = [torch.ones_like(a)], [torch.zeros_like(a)]  # of (a + ib)^m
    for _ in range(1, encoding.degree):
        c, s = real[-1], imaginary[-1]
        real.append(a * c - b * s)
        imaginary.append(a * s + b * c)
    results = []
    for _, m, polar in encoding.terms():
        height = sum(coefficient * z**power for power, coefficient in enumerate(polar) if coefficient)
        results.append(height * (real[m] if m >= 0 else imaginary[-m]))
    return torch.stack(results, dim=1)


@encode.register
def _(encoding: HashGrid, x: torch.Tensor, own: torch.Tensor) -> torch.Tensor:
    n_in, results = x.shape[1], []
    for level in encoding.tables(n_in):
        entries = own[level.start : level.start + level.size * encoding.features].reshape(level.size, -1)
        position = x * level.scale + 0.5
        whole = position.detach().floor()
        offset, total = position - whole, 0
        for corner in product((0, 1), repeat=n_in):
            weight, index = 1, 0
            for axis, bit in enumerate(corner):
                term = (whole[:, axis].long() + bit) * level.factors[axis] & WORD
                index = index ^ term if level.hashed else index + term & WORD
                weight = weight * (offset[:, axis] if bit else 1 - offset[:, axis])
            total = total + weight.unsqueeze(1) * entries[index % level.size]
        results.append(total)
    return torch.cat(results, dim=1)
