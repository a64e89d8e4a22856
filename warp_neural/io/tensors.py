"""Arrays and their description in one safetensors file: what networks, checkpoints and latent textures are kept in."""

import json
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path

_KEY = "warp_neural"  # safetensors' metadata are strings: ours is one JSON object under this name
_DTYPES = {
    "F16": "float16", "F32": "float32", "F64": "float64", "BOOL": "bool",
    "I8": "int8", "I16": "int16", "I32": "int32", "I64": "int64",
    "U8": "uint8", "U16": "uint16", "U32": "uint32", "U64": "uint64",
}  # fmt: skip
_MAX_DIMENSIONS = 32
_REMEDY = "copy or write the file again"


def save_tensors(path: Path | str, tensors: dict[str, np.ndarray], metadata: dict) -> None:
    """Write arrays of any shape (float16 to float64, integers, bool) and `metadata`, a dict that JSON can hold.

    The file appears whole or not at all: on a full disk the old one stays. Raises `InputError` for another dtype, for
    metadata beyond JSON, and where the file cannot be written.
    """
    arrays = {name: np.asarray(array, order="C") for name, array in tensors.items()}  # safetensors ignores strides
    for name, array in arrays.items():
        if array.dtype.name not in _DTYPES.values():
            raise InputError(f"{path}: tensor {name!r} of type {array.dtype}; use one of {', '.join(_DTYPES.values())}")
    try:
        text = json.dumps(metadata)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: metadata cannot be written as JSON ({error}); use plain values") from error
    data = save(arrays, metadata={_KEY: text})
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def load_tensors(path: Path | str) -> tuple[dict[str, np.ndarray], dict]:
    """The arrays, writable, and the metadata of a file by `save_tensors`.

    Raises `InputError` naming the field for any other file: missing, cut short, damaged, or from another program. The
    header is checked against the file's size before any array is made.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the name")
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = _metadata(path, (file.metadata() or {}).get(_KEY))
            return {name: _tensor(path, file, name) for name in file.keys()}, metadata
    except SafetensorError as error:
        raise InputError(f"{path}: not a whole safetensors file ({short(error)}); {_REMEDY}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error


def short(text: object) -> str:
    """One line of at most 200 characters, for quoting what a file holds in an error."""
    line = " ".join(str(text).split())
    return line if len(line) <= 200 else line[:197] + "..."


def _metadata(path: Path, text: str | None) -> dict:
    if text is None:
        raise InputError(f"{path}: metadata has no {_KEY!r}; it was not written by Warp Neural")
    try:
        metadata = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: metadata {_KEY!r} is not JSON ({short(error)}); {_REMEDY}") from error
    if not isinstance(metadata, dict):
        raise InputError(f"{path}: metadata {_KEY!r} is not a JSON object; {_REMEDY}")
    return metadata


def _tensor(path: Path, file: safe_open, name: str) -> np.ndarray:
    """One array; safetensors has checked sizes and offsets, here follows what NumPy cannot hold."""
    header = file.get_slice(name)
    dtype, shape = header.get_dtype(), header.get_shape()
    if dtype not in _DTYPES:
        raise InputError(f"{path}: tensor {short(name)!r} of type {dtype}; known types are {', '.join(_DTYPES)}")
    if len(shape) > _MAX_DIMENSIONS or any(size > 2**40 for size in shape):  # a size of 0 beside it makes it "fit"
        raise InputError(f"{path}: tensor {short(name)!r} has shape {short(shape)}, more than is possible; {_REMEDY}")
    return file.get_tensor(name)
