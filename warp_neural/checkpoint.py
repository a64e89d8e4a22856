"""Checkpoints of a `Trainer`: the network as `save_network` writes it, and the state of the run beside it."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warp_neural.errors import InputError
from warp_neural.network_data import network_tensors, parse_network
from warp_neural.network_file import from_mlp
from warp_neural.tensor_file import load_tensors, save_tensors

if TYPE_CHECKING:
    from warp_neural.trainer import Trainer

PREFIX = "training."  # of the tensors that belong to the run


def state_arrays(trainer: "Trainer") -> dict:
    """What changes from step to step beside the network, by name."""
    progress, options = trainer.progress, trainer.options
    names = ("skipped", "good", "flags", "scale", "losses")
    arrays = {name: getattr(progress, name) for name in names}
    arrays |= {"first": options.first, "second": options.second, "average": options.average}
    return arrays


def configuration(trainer: "Trainer") -> dict:
    """What has to be the same for the run to go on as it would have."""
    return {
        "seed": trainer.seed,
        "optimizer": type(trainer.optimizer).__name__,
        "settings": list(map(float, trainer.optimizer.settings)),
        "batches": trainer.batches,
        "fused": trainer.fused,
    }


def save_checkpoint(trainer: "Trainer", path: Path | str) -> None:
    tensors, network = network_tensors(path, from_mlp(trainer.net))
    tensors |= {PREFIX + name: array.numpy() for name, array in state_arrays(trainer).items()}
    metadata = {"format": "checkpoint", "version": 1, "step": trainer.index, "configuration": configuration(trainer)}
    save_tensors(path, tensors, metadata | {"network": network})


def load_checkpoint(trainer: "Trainer", path: Path | str) -> None:
    tensors, metadata = load_tensors(path)
    step, network = metadata.get("step"), metadata.get("network")
    if metadata.get("format") != "checkpoint" or metadata.get("version") != 1:
        raise InputError(f"{path}: not a checkpoint of a Trainer; see it with warp-neural info")
    if not isinstance(network, dict) or not isinstance(step, int) or not 0 <= step < 1 << 31:
        raise InputError(f"{path}: the checkpoint's step or network is damaged; use an earlier one")
    saved, here = metadata.get("configuration"), configuration(trainer)
    if saved != here:
        names = [name for name in here if not isinstance(saved, dict) or saved.get(name) != here[name]]
        raise InputError(f"{path}: of a run with another {', '.join(names)}; make the Trainer with the same arguments")
    data = parse_network(path, {k: v for k, v in tensors.items() if not k.startswith(PREFIX)}, network)
    mine = from_mlp(trainer.net)
    if replace(data.spec) != mine.spec or data.encoding != mine.encoding or data.n_in != mine.n_in:
        raise InputError(
            f"{path}: of another network, {describe(data)}, and this is {describe(mine)}; make the same MLP first"
        )
    arrays = state_arrays(trainer)
    for name, array in arrays.items():
        tensor = tensors.get(PREFIX + name)
        if tensor is None or tensor.shape != array.shape or tensor.dtype != array.numpy().dtype:
            raise InputError(f"{path}: tensor {PREFIX + name!r} is missing or of another size; use the same arguments")
    for name, array in arrays.items():
        array.assign(tensors[PREFIX + name])
    net = trainer.net
    layers = [array.ravel() for pair in zip(data.weights, data.biases, strict=True) for array in pair]
    master = net.master.numpy().copy()
    master[: net.n_parameters] = np.concatenate(layers)
    if data.encoding:
        master[net.encoding_start :] = data.encoding_parameters
    net.master.assign(master)
    net.pack()
    trainer.progress.counters.assign(np.full(2, step, np.int32))
    trainer.index = step


def describe(data) -> str:
    return f"{data.spec.format.name} {'-'.join(map(str, data.spec.sizes))}"
