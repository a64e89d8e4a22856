"""Networks in our own files: safetensors with parameters in float32 beside all that `NetworkState` holds.

Tensors: `weights.0`, ... [n_out, n_in] row major and `biases.0`, ... [n_out], with an axis [count] in front of each for
several networks; `steps` [count, layers, 2] of int8 networks (input, weight); `encoding` [count * n], the trainable
parameters of an encoding if the network begins with one.
"""

from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.io.tensors import load_tensors, save_tensors, short
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.encodings import Encoding
from warp_neural.kernels.nn.spec import FORMATS, INT8, MAX_SIZE, NetworkSpec
from warp_neural.nn.encoding_file import describe_encoding, make_encoding
from warp_neural.nn.kind import IMPLEMENTATIONS
from warp_neural.nn.mlp import MLP
from warp_neural.nn.state import NetworkState

_FORMAT, _VERSION = "network", 2
_ACTIVATIONS = {activation.name: activation for activation in activations.ALL}
_DTYPES = {"float32": wp.float32, "float16": wp.float16}
_REMEDY = "save it again with save_network"


def save_network(path: Path | str, net: MLP) -> None:
    """Write `net`, whole or not at all. Raises `InputError` for activations that are not `wn.activations`, and NaN."""
    write_state(path, net.state)


def load_network(path: Path | str, *, device: wp.DeviceLike = None) -> MLP:
    """The network of a file by `save_network`, equal bit for bit, on `device` (the current one by default).

    Raises `InputError` naming the field if the file is missing, damaged or something else.
    """
    return make_network(path, read_state(path), device)


def make_network(path: Path | str, state: NetworkState, device: wp.DeviceLike) -> MLP:
    """Of what was read from `path`, which errors name."""
    try:
        return MLP.from_state(state, device=device)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def write_state(path: Path | str, state: NetworkState) -> None:
    """Write it whole or not at all. Raises `InputError` for what files cannot hold: own functions, and NaN."""
    save_tensors(path, *to_tensors(path, state))


def read_state(path: Path | str) -> NetworkState:
    """What `write_state` wrote, every field checked. Raises `InputError` naming it."""
    return from_tensors(path, *load_tensors(path))


def to_tensors(path: Path | str, state: NetworkState) -> tuple[dict[str, np.ndarray], dict]:
    """The tensors and metadata of a file."""
    spec, encoding = state.spec, state.encoding
    for activation in (spec.activation, spec.output_activation):
        if activation not in activations.ALL:
            raise InputError(f"{path}: activation {activation.name!r} is your own; files hold those of wn.activations")
    if spec.format is INT8 and state.steps is None:
        raise InputError(f"{path}: an int8 network without steps; make an MLP of the state and calibrate it")
    tensors = {f"weights.{i}": weights for i, weights in enumerate(state.weights)}
    tensors |= {f"biases.{i}": biases for i, biases in enumerate(state.biases)}
    tensors |= {"steps": state.steps} if state.steps is not None else {}
    tensors |= {"encoding": state.encoding_parameters.ravel()} if encoding else {}
    if not all(np.isfinite(array).all() for array in tensors.values()):
        raise InputError(f"{path}: the parameters hold NaN or infinite values; train the network again")
    metadata = {
        "format": _FORMAT,
        "version": _VERSION,
        "sizes": spec.sizes,
        "activation": spec.activation.name,
        "output_activation": spec.output_activation.name,
        "precision": spec.format.name,
        "accumulation": spec.accumulation,
        "dtype": next(name for name, dtype in _DTYPES.items() if dtype is spec.dtype),
        "implementation": state.implementation,
        "count": state.count,
        "n_in": state.n_in,
        "encoding": describe_encoding(encoding) if encoding else None,
        "extra": state.extra,
    }
    try:
        if encoding and make_encoding(metadata["encoding"]) != encoding:
            raise ValueError("it does not return equal")
    except ValueError as error:
        raise InputError(f"{path}: {encoding}: {error}; files hold those of wn.encodings") from error
    return tensors, metadata


def from_tensors(path: Path | str, tensors: dict[str, np.ndarray], metadata: dict) -> NetworkState:
    """The state of a file's content."""
    left = dict(metadata)
    if left.pop("format", None) != _FORMAT:
        raise InputError(
            f"{path}: format {short(metadata.get('format'))!r}, not a network; see it with warp-neural info"
        )
    _take(path, left, "version", int, [_VERSION])
    spec = _spec(path, left)
    implementation = _take(path, left, "implementation", str, IMPLEMENTATIONS)
    count, extra = _take(path, left, "count", int), _take(path, left, "extra", dict)
    if count < 1:
        raise InputError(f"{path}: count {count} is not positive; {_REMEDY}")
    n_in, encoding = _take(path, left, "n_in", int), left.pop("encoding", None)
    if left:
        raise InputError(f"{path}: unknown metadata {short(', '.join(left))!r}; read it with a newer Warp Neural")
    if not 1 <= n_in <= MAX_SIZE or (encoding is None and n_in != spec.sizes[0]):
        raise InputError(f"{path}: n_in {n_in} does not fit the sizes {spec.sizes}; {_REMEDY}")

    left, lead, others = dict(tensors), (count,) if count > 1 else (), {}
    weights = [_take_tensor(path, left, f"weights.{i}", *lead, n, k) for i, (k, n) in enumerate(spec.layers)]
    biases = [_take_tensor(path, left, f"biases.{i}", *lead, n) for i, (_, n) in enumerate(spec.layers)]
    if spec.format is INT8:
        others["steps"] = _take_tensor(path, left, "steps", count, len(spec.layers), 2)
        if not (others["steps"] > 0).all():
            raise InputError(f"{path}: tensor 'steps' holds values that are not positive; {_REMEDY}")
    if encoding is not None:
        others["encoding"], n = _encoding(path, encoding, n_in, spec)
        others |= {"n_in": n_in, "encoding_parameters": _take_tensor(path, left, "encoding", count * n)}
    if left:
        raise InputError(f"{path}: unknown tensors {short(', '.join(left))!r}; {_REMEDY}")
    return NetworkState.of_layers(spec, weights, biases, count, implementation=implementation, extra=extra, **others)


def _spec(path: Path | str, left: dict) -> NetworkSpec:
    sizes = _take(path, left, "sizes", list)
    if not all(type(size) is int for size in sizes):
        raise InputError(f"{path}: sizes {short(sizes)} are not integers; {_REMEDY}")
    names = [_take(path, left, name, str, _ACTIVATIONS) for name in ("activation", "output_activation")]
    format = FORMATS[_take(path, left, "precision", str, FORMATS)]
    accumulation = _take(path, left, "accumulation", str)
    dtype = _DTYPES[_take(path, left, "dtype", str, _DTYPES)]
    try:
        return NetworkSpec(tuple(sizes), *(_ACTIVATIONS[name] for name in names), format, accumulation, dtype)
    except ValueError as error:
        raise InputError(f"{path}: {short(error)}; {_REMEDY}") from error


def _encoding(path: Path | str, description: Any, n_in: int, spec: NetworkSpec) -> tuple[Encoding, int]:
    """The encoding and its number of parameters."""
    try:
        encoding = make_encoding(description)
        if encoding.n_out(n_in) != spec.sizes[0] or spec.dtype is not wp.float32:
            raise ValueError(f"{encoding.n_out(n_in)} float32 results of {n_in} inputs do not fit the network")
        return encoding, encoding.n_parameters(n_in)
    except (ValueError, ArithmeticError) as error:
        raise InputError(f"{path}: encoding: {short(error)}; {_REMEDY}") from error


def _take(path: Path | str, left: dict, name: str, kind: type, choices: Any = None) -> Any:
    """A field of the metadata, of that type and one of the choices."""
    value = left.pop(name, None)
    if type(value) is not kind or (choices is not None and value not in choices):
        wanted = f"one of {', '.join(map(str, choices))}" if choices else f"of type {kind.__name__}"
        raise InputError(f"{path}: {name} {short(value)!r} is not {wanted}; {_REMEDY}")
    return value


def _take_tensor(path: Path | str, left: dict[str, np.ndarray], name: str, *shape: int) -> np.ndarray:
    array = left.pop(name, None)
    if array is None or array.dtype != np.float32 or array.shape != shape:
        found = "is missing" if array is None else f"is {array.dtype} {list(array.shape)}"
        raise InputError(f"{path}: tensor {name!r} {found}, not float32 {list(shape)}; {_REMEDY}")
    if not np.isfinite(array).all():
        raise InputError(f"{path}: tensor {name!r} holds NaN or infinite values; train the network again")
    return array
