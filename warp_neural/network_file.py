"""Networks in our own files: safetensors with weights and biases in float32 beside all that `MLP` needs.

Tensors: `weights.0`, ... [n_out, n_in] row major and `biases.0`, ... [n_out], with an axis [count] in front of each for
several networks; `steps` [count, layers, 2] of int8 networks (input, weight); `encoding`, its trainable parameters.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from kernels import activations
from kernels.coopvec.spec import FORMATS, INT8, NetworkSpec
from warp_neural.errors import InputError
from warp_neural.network import MLP
from warp_neural.tensor_file import load_tensors, save_tensors, short

_FORMAT, _VERSION = "network", 1
_ACTIVATIONS = {activation.name: activation for activation in activations.ALL}
_DTYPES = {"float32": wp.float32, "float16": wp.float16}
_REMEDY = "save it again with save_network"


@dataclass(frozen=True)
class NetworkData:
    """A network as a file holds it, on the host.

    weights: of each layer, float32 [n_out, n_in], or [count, n_out, n_in] if count > 1; biases alike. steps: float32
    [count, layers, 2] of int8 networks, None otherwise. extra: what else came with it, of plain JSON values.
    """

    spec: NetworkSpec
    weights: list[np.ndarray]
    biases: list[np.ndarray]
    count: int = 1
    steps: np.ndarray | None = None
    extra: dict = field(default_factory=dict)


def save_network(net: MLP, path: Path | str) -> None:
    """Write `net`, whole or not at all. Raises `InputError` for activations that are not `wn.activations`."""
    steps = net.steps.numpy() if net.spec.format is INT8 else None
    write_network(path, NetworkData(net.spec, net.weights, net.biases, net.count, steps))


def load_network(path: Path | str, *, device: wp.DeviceLike = None) -> MLP:
    """The network of a file by `save_network`, equal bit for bit, on `device` (the current one by default).

    Raises `InputError` naming the field if the file is missing, damaged or something else.
    """
    return make_network(path, read_network(path), device=device)


def make_network(path: Path | str, data: NetworkData, *, device: wp.DeviceLike = None) -> MLP:
    """An `MLP` of what was read from `path`."""
    spec = data.spec
    n_in, *hidden, n_out = spec.sizes
    if len(set(hidden)) > 1:
        raise InputError(f"{path}: hidden layers of sizes {hidden}; an MLP has one width: train it with one")
    net = MLP(
        n_in,
        n_out,
        width=hidden[0] if hidden else 1,
        depth=len(hidden),
        activation=spec.activation,
        output_activation=spec.output_activation,
        precision=spec.format.name,
        accumulation=spec.accumulation,
        dtype=spec.dtype,
        count=data.count,
        device=device,
    )
    layers = [array.reshape(data.count, -1) for pair in zip(data.weights, data.biases, strict=True) for array in pair]
    net.master.assign(np.hstack(layers).ravel())
    if data.steps is not None:
        net.steps.assign(data.steps)
    net.pack()
    return net


def write_network(path: Path | str, data: NetworkData) -> None:
    spec = data.spec
    for activation in (spec.activation, spec.output_activation):
        if activation not in activations.ALL:
            raise InputError(f"{path}: activation {activation.name!r} is your own; files hold those of wn.activations")
    if not all(np.isfinite(array).all() for array in data.weights + data.biases):
        raise InputError(f"{path}: weights or biases are NaN or infinite; train the network again")
    metadata = {
        "format": _FORMAT,
        "version": _VERSION,
        "sizes": spec.sizes,
        "activation": spec.activation.name,
        "output_activation": spec.output_activation.name,
        "precision": spec.format.name,
        "accumulation": spec.accumulation,
        "dtype": next(name for name, dtype in _DTYPES.items() if dtype is spec.dtype),
        "count": data.count,
        "extra": data.extra,
    }
    tensors = {f"weights.{i}": weights for i, weights in enumerate(data.weights)}
    tensors |= {f"biases.{i}": biases for i, biases in enumerate(data.biases)}
    if data.steps is not None:
        tensors["steps"] = data.steps
    save_tensors(path, tensors, metadata)


def read_network(path: Path | str) -> NetworkData:
    """What `write_network` wrote, every field checked. Raises `InputError` naming it."""
    return parse_network(path, *load_tensors(path))


def parse_network(path: Path | str, tensors: dict[str, np.ndarray], metadata: dict) -> NetworkData:
    """The same of a file's content."""
    path, left = Path(path), dict(metadata)

    def take(name: str, kind: type, choices: Any = None) -> Any:
        value = left.pop(name, None)
        if type(value) is not kind or (choices is not None and value not in choices):
            wanted = f"one of {', '.join(map(str, choices))}" if choices else f"of type {kind.__name__}"
            raise InputError(f"{path}: {name} {short(value)!r} is not {wanted}; {_REMEDY}")
        return value

    take("format", str, [_FORMAT])
    take("version", int, [_VERSION])
    sizes = take("sizes", list)
    if not all(type(size) is int for size in sizes):
        raise InputError(f"{path}: sizes {short(sizes)} are not integers; {_REMEDY}")
    activation = _ACTIVATIONS[take("activation", str, _ACTIVATIONS)]
    output_activation = _ACTIVATIONS[take("output_activation", str, _ACTIVATIONS)]
    format = FORMATS[take("precision", str, FORMATS)]
    accumulation, dtype = take("accumulation", str), _DTYPES[take("dtype", str, _DTYPES)]
    count, extra = take("count", int), take("extra", dict)
    if count < 1:
        raise InputError(f"{path}: count {count} is not positive; {_REMEDY}")
    if left:
        raise InputError(f"{path}: unknown metadata {short(', '.join(left))!r}; read it with a newer Warp Neural")
    try:
        spec = NetworkSpec(tuple(sizes), activation, output_activation, format, accumulation, dtype)
    except ValueError as error:
        raise InputError(f"{path}: {short(error)}; {_REMEDY}") from error
    return _with_tensors(path, tensors, spec, count, extra)


def _with_tensors(
    path: Path, tensors: dict[str, np.ndarray], spec: NetworkSpec, count: int, extra: dict
) -> NetworkData:
    lead, left = ((count,) if count > 1 else ()), dict(tensors)

    def take(name: str, *shape: int) -> np.ndarray:
        array = left.pop(name, None)
        if array is None or array.dtype != np.float32 or array.shape != shape:
            found = "is missing" if array is None else f"is {array.dtype} {list(array.shape)}"
            raise InputError(f"{path}: tensor {name!r} {found}, not float32 {list(shape)}; {_REMEDY}")
        if not np.isfinite(array).all():
            raise InputError(f"{path}: tensor {name!r} holds NaN or infinite values; train the network again")
        return array

    weights = [take(f"weights.{i}", *lead, n, k) for i, (k, n) in enumerate(spec.layers)]
    biases = [take(f"biases.{i}", *lead, n) for i, (_, n) in enumerate(spec.layers)]
    steps = take("steps", count, len(spec.layers), 2) if spec.format is INT8 else None
    if steps is not None and not (steps > 0).all():
        raise InputError(f"{path}: tensor 'steps' holds values that are not positive; {_REMEDY}")
    if left:
        raise InputError(f"{path}: unknown tensors {short(', '.join(left))!r}; {_REMEDY}")
    return NetworkData(spec, weights, biases, count, steps, extra)
