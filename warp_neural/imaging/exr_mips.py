"""One EXR with all mip levels of a picture, as renderers read it: tiled, MIPMAP_LEVELS.

OpenImageIO reads them; it does not write them here, because on a full disk it would not come back. The OpenEXR module
writes the first level only, though it does pack tiles. So each level is packed as a tiled file of one level in memory,
and the packed tiles are moved into the file of many: "OpenEXR File Layout", openexr.com, sections Header, Offset
Tables and Tiles.
"""

import io
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import OpenEXR

from warp_neural.errors import InputError
from warp_neural.imaging.exr import check_parts, checked_channels, read_channels
from warp_neural.imaging.openimageio import opened
from warp_neural.imaging.stored import read_file
from warp_neural.io.files import atomic_path

_TILE = 64
_MIPMAP_LEVELS = 1  # rounded down


def save_exr_mips(path: Path | str, levels: Sequence[np.ndarray], names: Sequence[str] = ("R", "G", "B")) -> None:
    """Write a mip chain as one EXR: `levels[k]` is `[max(1, height >> k), max(1, width >> k), channels]`, down to 1x1.

    float16, float32 or uint32, stored exactly (ZIP); `names` are the channels' names in order. `[h, w]` is one channel.
    Raises `InputError` for a chain that is incomplete or of other sizes or types, or if not writable.
    """
    path = Path(path)
    levels = [level[..., None] if level.ndim == 2 else level for level in levels]
    _check_chain(path, levels, names)
    files = [_pack_level(path, dict(zip(names, np.moveaxis(level, -1, 0), strict=True))) for level in levels]
    header = bytearray(files[0][: _table_of(files[0])])
    header[header.index(b"tiles\0tiledesc\0") + 15 + 4 + 8] = _MIPMAP_LEVELS  # after the size and the tiles' sides
    tiles = [tile[:8] + struct.pack("<2i", k, k) + tile[16:] for k, file in enumerate(files) for tile in _tiles(file)]
    offsets = len(header) + 8 * len(tiles) + np.cumsum([0] + [len(tile) for tile in tiles[:-1]])
    with atomic_path(path) as temporary:
        temporary.write_bytes(bytes(header) + offsets.astype("<u8").tobytes() + b"".join(tiles))


def load_exr_mips(path: Path | str) -> list[dict[str, np.ndarray]]:
    """The levels of an EXR with mip levels, finest first: each its channels by name, `[height, width]`, as stored.

    Raises `InputError` for an EXR without mip levels and as `load_exr` does.
    """
    path = Path(path)
    levels = []
    with opened(read_file(path), ".exr", path) as file:
        check_parts(file, path)
        if file.spec().get_int_attribute("openexr:roundingmode", -1) < 0:
            raise InputError(f"{path}: an EXR of one level, without mip levels; read it with load_exr")
        while file.seek_subimage(0, len(levels)):
            levels.append(read_channels(file, path))
    return levels


def _check_chain(path: Path, levels: list[np.ndarray], names: Sequence[str]) -> None:
    if not levels or any(level.ndim != 3 or 0 in level.shape for level in levels):
        raise InputError(f"{path}: mip levels must be [height, width, channels]; give at least one")
    height, width = levels[0].shape[:2]
    expected = [(max(1, height >> k), max(1, width >> k)) for k in range(max(height, width).bit_length())]
    if [level.shape[:2] for level in levels] != expected:
        sizes = ", ".join(f"{w} x {h}" for h, w in expected)
        raise InputError(f"{path}: an EXR's mip levels must halve, rounded down, to 1 x 1: {sizes}")
    if any(level.shape[-1] != len(names) or level.dtype != levels[0].dtype for level in levels):
        raise InputError(f"{path}: every mip level needs the {len(names)} channels {', '.join(names)} and one dtype")


def _pack_level(path: Path, channels: Mapping[str, np.ndarray]) -> bytes:
    """A whole tiled EXR with one level."""
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = _TILE
    tiles.mode = OpenEXR.ONE_LEVEL
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": tiles}
    out = io.BytesIO()
    OpenEXR.File(header, checked_channels(path, channels)).write(out)
    return out.getvalue()


def _table_of(file: bytes) -> int:
    """Where the offset table begins: after the attributes, (name, type, size, value) each, and a null byte."""
    at = 8  # after the magic number and the version
    while file[at] != 0:
        at = file.index(b"\0", file.index(b"\0", at) + 1) + 1
        at += 4 + int.from_bytes(file[at : at + 4], "little")
    return at + 1


def _tiles(file: bytes) -> list[bytes]:
    """The packed tiles, each with its five-integer head, in the order of the offset table."""
    table = _table_of(file)
    (first,) = struct.unpack_from("<Q", file, table)
    offsets = [offset for (offset,) in struct.iter_unpack("<Q", file[table : min(first, len(file))])]
    return [file[offset : offset + 20 + struct.unpack_from("<i", file, offset + 16)[0]] for offset in offsets]
