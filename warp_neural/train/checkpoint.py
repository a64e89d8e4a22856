"""Checkpoints of a run: the network as `save_network` writes it, and the state of the run beside it."""

from pathlib import Path

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.io.tensors import load_tensors, save_tensors
from warp_neural.nn.mlp import MLP
from warp_neural.nn.network_data import NetworkData, network_tensors, parse_network
from warp_neural.nn.network_file import from_mlp

PREFIX = "training."  # of the tensors that belong to the run


def save_checkpoint(path: Path | str, net: MLP, step: int, configuration: dict, state: dict[str, wp.array]) -> None:
    """configuration: what has to be the same for the run to go on as it would have. state: what changes in a step."""
    tensors, network = network_tensors(path, from_mlp(net))
    tensors |= {PREFIX + name: array.numpy() for name, array in state.items()}
    metadata = {"format": "checkpoint", "version": 1, "step": step, "configuration": configuration}
    save_tensors(path, tensors, metadata | {"network": network})


def load_checkpoint(path: Path | str, net: MLP, configuration: dict, state: dict[str, wp.array]) -> int:
    """The step, after network and state have been set; nothing is unless all of the file is right."""
    tensors, metadata = load_tensors(path)
    step, network = metadata.get("step"), metadata.get("network")
    if metadata.get("format") != "checkpoint" or metadata.get("version") != 1:
        raise InputError(f"{path}: not a checkpoint of a Trainer; see it with warp-neural info")
    if not isinstance(network, dict) or not isinstance(step, int) or not 0 <= step < 1 << 31:
        raise InputError(f"{path}: the checkpoint's step or network is damaged; use an earlier one")
    saved = metadata.get("configuration")
    if saved != configuration:
        names = [
            name for name in configuration if not isinstance(saved, dict) or saved.get(name) != configuration[name]
        ]
        raise InputError(f"{path}: of a run with another {', '.join(names)}; make the Trainer with the same arguments")
    data = parse_network(path, {k: v for k, v in tensors.items() if not k.startswith(PREFIX)}, network)
    mine = from_mlp(net)
    if data.spec != mine.spec or data.encoding != mine.encoding or data.n_in != mine.n_in:
        raise InputError(
            f"{path}: of another network, {describe(data)}, and this is {describe(mine)}; make the same MLP first"
        )
    for name, array in state.items():
        tensor = tensors.get(PREFIX + name)
        if tensor is None or tensor.shape != array.shape or tensor.dtype != array.numpy().dtype:
            raise InputError(f"{path}: tensor {PREFIX + name!r} is missing or of another size; use the same arguments")
    for name, array in state.items():
        array.assign(tensors[PREFIX + name])
    layers = [array.ravel() for pair in zip(data.weights, data.biases, strict=True) for array in pair]
    master = net.master.numpy().copy()
    master[: net.n_parameters] = np.concatenate(layers)
    if data.encoding:
        master[net.encoding_start :] = data.encoding_parameters
    net.master.assign(master)
    net.pack()
    return step


def describe(data: NetworkData) -> str:
    return f"{data.spec.format.name} {'-'.join(map(str, data.spec.sizes))}"
