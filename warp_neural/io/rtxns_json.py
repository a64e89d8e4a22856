"""RTXNS's JSON: an object with `layers`, each of `num_inputs`, `num_outputs`, `weights` (flat, row major) and `biases`.

Other keys of the object are kept. Activations are not in the file, see `warp_neural.io.rtxns`.
"""

import json
from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path
from warp_neural.io.rtxns import RtxnsNetwork, read_bytes, refusal
from warp_neural.io.tensors import short


def read_json(path: Path | str) -> RtxnsNetwork:
    """Read RTXNS's JSON into float32 arrays.

    Raises `InputError` that names the field for text that is not JSON, and for sizes, types and values that contradict
    each other or are not finite.
    """
    path = Path(path)
    try:
        content = json.loads(read_bytes(path), parse_constant=_refuse_constant)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON ({short(error)}); write or copy it again") from error
    layers = content.pop("layers", None) if isinstance(content, dict) else None
    if not isinstance(layers, list) or not layers:
        raise refusal(path, "layers", "missing or no list with a layer; RTXNS's JSON is an object with `layers`")
    weights, biases, n_before = [], [], None
    for index, layer in enumerate(layers):
        if not isinstance(layer, dict):
            raise refusal(path, f"layers[{index}]", "no object")
        k, n = (_size(path, index, layer, name) for name in ("num_inputs", "num_outputs"))
        if n_before not in (None, k):
            raise refusal(path, f"layers[{index}].num_inputs", f"{k}, where the layer before has {n_before} outputs")
        weights.append(_values(path, index, layer, "weights", n * k).reshape(n, k))
        biases.append(_values(path, index, layer, "biases", n))
        n_before = n
    return RtxnsNetwork(weights, biases, content)


def write_json(path: Path | str, network: RtxnsNetwork) -> None:
    """Write RTXNS's JSON with every digit, so that float32 values return bit for bit, beside `network.extra`."""
    layers = []
    for weights, biases in zip(network.weights, network.biases, strict=True):
        n, k = weights.shape
        flat = {"weights": weights.ravel().tolist(), "biases": biases.tolist()}
        layers.append({"num_inputs": k, "num_outputs": n, **flat})
    try:
        text = json.dumps({**network.extra, "layers": layers}, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be written as JSON ({short(error)}); use finite values") from error
    with atomic_path(path) as temporary:
        temporary.write_bytes(text.encode())


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not a number of JSON")


def _size(path: Path, index: int, layer: dict, name: str) -> int:
    value = layer.get(name)
    if type(value) is not int or not 1 <= value < 2**31:
        raise refusal(path, f"layers[{index}].{name}", f"{short(value)!r}, not a positive 32-bit integer")
    return value


def _values(path: Path, index: int, layer: dict, name: str, count: int) -> np.ndarray:
    """A flat list of `count` numbers as float32."""
    values, where = layer.get(name), f"layers[{index}].{name}"
    if not isinstance(values, list) or len(values) != count:
        found = f"{len(values)} values" if isinstance(values, list) else "no list"
        raise refusal(path, where, f"{found}, where the sizes need {count}")
    if not all(type(value) in (int, float) for value in values):
        raise refusal(path, where, "holds something other than numbers")
    with np.errstate(over="ignore"):
        try:
            array = np.array(values, np.float64).astype(np.float32)
        except OverflowError:
            array = np.array(np.inf)
    if not np.isfinite(array).all():
        raise refusal(path, where, "holds values beyond float32")
    return array
