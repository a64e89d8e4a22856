"""`.wnm`: a neural material in one file, safetensors with the networks as in `nn.network_file`.

Tensors: `decoder.weights.0`, ... float32, likewise of `frames` and `sampler`; `latents.0`, ... uint8 [height, width,
LATENTS], each level half of the one before down to one texel; `scale` float32 [LATENTS, 2]: a latent is x + code y.
"""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.io.tensors import load_tensors, save_tensors, short
from warp_neural.kernels.materials.neural_spec import LATENTS, NeuralSpec
from warp_neural.materials.neural_state import NeuralState
from warp_neural.nn.network_file import from_tensors, to_tensors

FORMAT, _VERSION = "neural_material", 1
_REMEDY = "bake the material again"
_FIELDS = {"format", "version", "spec", "source", "metrics", "levels", "networks"}


def write_neural(path: Path | str, state: NeuralState) -> None:
    """Whole or not at all."""
    tensors, networks = {"scale": state.scale}, {}
    for name, network in state.networks.items():
        own, networks[name] = to_tensors(path, network)
        tensors |= {f"{name}.{key}": array for key, array in own.items()}
    tensors |= {f"latents.{i}": codes for i, codes in enumerate(state.codes)}
    about = {"source": state.source, "metrics": state.metrics, "levels": len(state.codes), "networks": networks}
    save_tensors(path, tensors, {"format": FORMAT, "version": _VERSION, "spec": asdict(state.spec), **about})


def read_neural(path: Path | str) -> NeuralState:
    """What `write_neural` wrote, every field checked. Raises `InputError` naming it."""
    return neural_from_tensors(path, *load_tensors(path))


def neural_from_tensors(path: Path | str, tensors: dict[str, np.ndarray], metadata: dict) -> NeuralState:
    """The state of a file's content."""
    if metadata.get("format") != FORMAT:
        found = short(metadata.get("format"))
        raise InputError(f"{path}: format {found!r}, not a neural material; see it with warp-neural info")
    if metadata.get("version") != _VERSION:
        found = short(metadata.get("version"))
        raise InputError(f"{path}: version {found!r}, and this reads {_VERSION}; read it with a newer Warp Neural")
    if set(metadata) != _FIELDS:
        raise InputError(f"{path}: metadata {short(sorted(set(metadata) ^ _FIELDS))} is missing or unknown; {_REMEDY}")
    for name, kind in {"spec": dict, "source": str, "metrics": dict, "levels": int, "networks": dict}.items():
        if type(metadata[name]) is not kind:
            raise InputError(f"{path}: {name} {short(metadata[name])!r} is not of type {kind.__name__}; {_REMEDY}")
    spec, left = _spec(path, metadata["spec"]), dict(tensors)
    networks = {name: _network(path, name, left, metadata["networks"]) for name in spec.networks}
    for name, network in networks.items():
        if network.spec != spec.networks[name] or network.count != 1:
            raise InputError(f"{path}: {name} is {short(network.description)}, not what {spec} has; {_REMEDY}")
    codes, scale = _latents(path, left, metadata["levels"]), _take(path, left, "scale", "float32", (LATENTS, 2))
    if left:
        raise InputError(f"{path}: unknown tensors {short(', '.join(left))!r}; {_REMEDY}")
    return NeuralState(spec, networks, codes, scale, metadata["source"], metadata["metrics"])


def _spec(path: Path | str, values: dict) -> NeuralSpec:
    try:
        return NeuralSpec(**values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: spec: {short(error)}; {_REMEDY}") from error


def _network(path: Path | str, name: str, left: dict[str, np.ndarray], described: dict):
    own = {key.removeprefix(f"{name}."): left.pop(key) for key in list(left) if key.startswith(f"{name}.")}
    if not isinstance(described.get(name), dict):
        raise InputError(f"{path}: networks: no {name}; {_REMEDY}")
    return from_tensors(f"{path}: {name}", own, described[name])


def _latents(path: Path | str, left: dict[str, np.ndarray], levels: int) -> tuple[np.ndarray, ...]:
    first = left.get("latents.0")
    if first is None or first.ndim != 3 or not 1 <= levels <= 32 or not first.size:
        raise InputError(f"{path}: tensor 'latents.0' or levels {levels} is not what it can be; {_REMEDY}")
    height, width = first.shape[:2]
    shapes = [(max(height >> i, 1), max(width >> i, 1), LATENTS) for i in range(levels)]
    return tuple(_take(path, left, f"latents.{i}", "uint8", shape) for i, shape in enumerate(shapes))


def _take(path: Path | str, left: dict[str, np.ndarray], name: str, dtype: str, shape: tuple[int, ...]) -> np.ndarray:
    array = left.pop(name, None)
    if array is None or array.dtype.name != dtype or array.shape != shape:
        found = "is missing" if array is None else f"is {array.dtype} {list(array.shape)}"
        raise InputError(f"{path}: tensor {name!r} {found}, not {dtype} {list(shape)}; {_REMEDY}")
    if not np.isfinite(array).all():
        raise InputError(f"{path}: tensor {name!r} holds NaN or infinite values; {_REMEDY}")
    return array
