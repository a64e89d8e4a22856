"""Checkpoints of a run: the network as `save_network` writes it, and the state of the run beside it."""

from pathlib import Path

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.io.tensors import load_tensors, save_tensors, short
from warp_neural.nn.mlp import MLP
from warp_neural.nn.network_file import from_tensors, to_tensors

_FORMAT, _VERSION = "checkpoint", 2
PREFIX = "training."  # of the tensors that belong to the run


def save_checkpoint(path: Path | str, net: MLP, step: int, configuration: dict, state: dict[str, wp.array]) -> None:
    """configuration: what has to be the same for the run to go on as it would have. state: what changes in a step."""
    tensors, network = to_tensors(path, net.state)
    tensors |= {PREFIX + name: array.numpy() for name, array in state.items()}
    metadata = {"format": _FORMAT, "version": _VERSION, "step": step, "configuration": configuration}
    save_tensors(path, tensors, metadata | {"network": network})


def load_checkpoint(path: Path | str, net: MLP, configuration: dict, state: dict[str, wp.array]) -> int:
    """The step, after network and state have been set; nothing is unless all of the file is right."""
    tensors, metadata = load_tensors(path)
    step, network = metadata.get("step"), metadata.get("network")
    if metadata.get("format") != _FORMAT:
        raise InputError(f"{path}: not a checkpoint of a Trainer; see it with warp-neural info")
    if metadata.get("version") != _VERSION:
        found = short(metadata.get("version"))
        raise InputError(f"{path}: a checkpoint of version {found}, not {_VERSION}; train again from the start")
    if not isinstance(network, dict) or not isinstance(step, int) or not 0 <= step < 1 << 31:
        raise InputError(f"{path}: the checkpoint's step or network is damaged; use an earlier one")
    saved = metadata.get("configuration")
    if saved != configuration:
        saved = saved if isinstance(saved, dict) else {}
        names = [name.replace("_", " ") for name in configuration if saved.get(name) != configuration[name]]
        raise InputError(f"{path}: of a run with another {', '.join(names)}; make the Trainer with the same arguments")
    network = from_tensors(path, {k: v for k, v in tensors.items() if not k.startswith(PREFIX)}, network)
    try:
        net.require_kind(network)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    values = {name: _checked(path, name, array, tensors.get(PREFIX + name)) for name, array in state.items()}
    net.load_state(network)
    for name, array in state.items():
        array.assign(values[name])
    return step


def _checked(path: Path | str, name: str, array: wp.array, tensor: np.ndarray | None) -> np.ndarray:
    """What `array` can become; skipped steps have left losses that are not finite."""
    if tensor is None or tensor.shape != array.shape or tensor.dtype != array.numpy().dtype:
        raise InputError(f"{path}: tensor {PREFIX + name!r} is missing or of another size; use the same arguments")
    if name != "losses" and not np.isfinite(tensor).all():
        raise InputError(f"{path}: tensor {PREFIX + name!r} holds NaN or infinite values; use an earlier checkpoint")
    return tensor
