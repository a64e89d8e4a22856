"""`MLP` from and to our own files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.nn.spec import INT8
from warp_neural.nn.mlp import MLP
from warp_neural.nn.network_data import NetworkData, read_network, write_network


def save_network(path: Path | str, net: MLP) -> None:
    """Write `net`, whole or not at all. Raises `InputError` for activations that are not `wn.activations`."""
    write_network(path, from_mlp(net))


def load_network(path: Path | str, *, device: wp.DeviceLike = None) -> MLP:
    """The network of a file by `save_network`, equal bit for bit, on `device` (the current one by default).

    Raises `InputError` naming the field if the file is missing, damaged or something else.
    """
    return make_network(path, read_network(path), device=device)


def from_mlp(net: MLP) -> NetworkData:
    """A copy on the host."""
    data = NetworkData(net.spec, net.weights, net.biases, net.count)
    if net.spec.format is INT8:
        data = replace(data, steps=net.steps.numpy().copy())
    if net.encoding:
        parameters = net.master.numpy()[net.encoding_start :].copy()
        data = replace(data, encoding=net.encoding, n_in=net.n_in, encoding_parameters=parameters)
    return data


def make_network(path: Path | str, data: NetworkData, *, device: wp.DeviceLike = None) -> MLP:
    """An `MLP` of what was read from `path`."""
    spec = data.spec
    hidden = spec.sizes[1:-1]
    if len(set(hidden)) > 1:
        raise InputError(f"{path}: hidden layers of sizes {hidden}; an MLP has one width: train it with one")
    net = MLP(
        data.n_in if data.encoding else spec.sizes[0],
        spec.sizes[-1],
        width=hidden[0] if hidden else 1,
        depth=len(hidden),
        encoding=data.encoding,
        activation=spec.activation,
        output_activation=spec.output_activation,
        precision=spec.format.name,
        accumulation=spec.accumulation,
        dtype=spec.dtype,
        count=data.count,
        device=device,
    )
    layers = [array.reshape(data.count, -1) for pair in zip(data.weights, data.biases, strict=True) for array in pair]
    master = net.master.numpy().copy()
    master[: data.count * spec.n_parameters] = np.hstack(layers).ravel()
    if data.encoding:
        master[net.encoding_start :] = data.encoding_parameters
    net.master.assign(master)
    if data.steps is not None:
        net.steps.assign(data.steps)
    net.pack()
    return net
