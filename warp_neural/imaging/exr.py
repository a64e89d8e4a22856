"""OpenEXR files: any named channels, half, float or uint, every compression the OpenEXR library reads."""

import io
from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import BinaryIO

import numpy as np
import OpenEXR

from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path

MAX_PIXELS = 2**27
"""The largest picture that is read, e.g. 16384 x 8192: a header that claims more is refused before memory is taken."""

_MAX_TILE = 2**24
_PIXEL_TYPES = (np.float16, np.float32, np.uint32)


def load_exr(path: Path | str) -> dict[str, np.ndarray]:
    """Every channel of a single-part EXR by its name, as stored: float16, float32 or uint32 `[height, width]`.

    The pixels are those of the data window; values are not judged, so depth may be infinite. A subsampled channel keeps
    its smaller size. Raises `InputError` for multi-part and deep files and for damaged ones.
    """
    path = Path(path)
    check_header(path)
    return read_channels(path, path)


def save_exr(
    path: Path | str, channels: Mapping[str, np.ndarray], *, compression: OpenEXR.Compression = OpenEXR.ZIP_COMPRESSION
) -> None:
    """Write named channels, each float16, float32 or uint32 `[height, width]` and all of one size, losslessly (ZIP).

    B44, DWAA and DWAB `compression` change values. Raises `InputError` for other dtypes or shapes, or if not writable.
    """
    path = Path(path)
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    file = OpenEXR.File(header, checked_channels(path, channels))
    with atomic_path(path) as temporary:
        write_file(file, str(temporary), path)


def checked_channels(path: Path, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """`channels` in memory as the library wants them, or an `InputError` that says what an EXR cannot hold."""
    pixels = {name: np.ascontiguousarray(values) for name, values in channels.items()}
    if not pixels:
        raise InputError(f"{path}: there is no channel to save; give at least one")
    shapes = {name: values.shape for name, values in pixels.items()}
    if len(set(shapes.values())) > 1 or any(len(shape) != 2 or 0 in shape for shape in shapes.values()):
        raise InputError(f"{path}: EXR channels must be [height, width] and of one size, not {shapes}")
    for name, values in pixels.items():
        if values.dtype not in _PIXEL_TYPES:
            raise InputError(f"{path}: channel {name} is {values.dtype}; convert it to float16, float32 or uint32")
    return pixels


def read_channels(source: Path | BinaryIO, path: Path) -> dict[str, np.ndarray]:
    """The channels of the first part of `source`; errors are `InputError`s about `path`."""
    with redirect_stdout(io.StringIO()):  # a part that fails is printed and left out, not raised
        parts = _open(source, path).parts
    if not parts:
        raise InputError(f"{path}: the EXR's pixel data is cut short or damaged; export or copy it again")
    return {name: channel.pixels for name, channel in parts[0].channels.items()}


def write_file(file: OpenEXR.File, target: str | BinaryIO, path: Path) -> None:
    """Write `file` to `target`, a path or stream; the library's own errors become an `InputError` about `path`."""
    try:
        file.write(target)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{path}: the EXR could not be written ({error}); nothing was changed") from error


def _open(source: Path | BinaryIO, path: Path, header_only: bool = False) -> OpenEXR.File:
    source = str(source) if isinstance(source, Path) else source
    try:
        return OpenEXR.File(source, separate_channels=True, header_only=header_only)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{path}: not a whole, readable EXR ({error}); export or copy it again") from error


def check_header(path: Path) -> None:
    """Refuse, from the header alone, what is not one flat picture of a sensible size."""
    parts = _open(path, path, header_only=True).parts
    if len(parts) > 1:
        names = ", ".join(part.header.get("name", "unnamed") for part in parts)
        raise InputError(f"{path}: multi-part EXR with the parts {names}; save the one you want as a single-part EXR")
    header = parts[0].header
    if header["type"] in (OpenEXR.deepscanline, OpenEXR.deeptile):
        raise InputError(f"{path}: deep EXR (many samples a pixel); flatten it first")
    low, high = (np.asarray(corner, dtype=np.int64) for corner in header["dataWindow"])
    width, height = (int(size) for size in high - low + 1)
    if width * height * max(1, len(header["channels"]) / 4) > MAX_PIXELS:
        raise InputError(f"{path}: claims {width} x {height} pixels, more than {MAX_PIXELS} in all; scale it down")
    tiles = header.get("tiles")
    if tiles and tiles.xSize * tiles.ySize > _MAX_TILE:  # the library takes memory for whole tiles
        raise InputError(f"{path}: tiles of {tiles.xSize} x {tiles.ySize} pixels; save it with smaller ones")
