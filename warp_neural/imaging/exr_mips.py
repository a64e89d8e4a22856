"""One EXR with all mip levels of a picture, as renderers read it: tiled, MIPMAP_LEVELS.

The OpenEXR Python module reads and writes the first level only, though it does pack tiles. So each level is made as a
tiled file of one level, and this module moves the packed tiles between those and the file of many: "OpenEXR File
Layout", openexr.com, sections Header, Offset Tables and Tiles.
"""

import io
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import OpenEXR

from warp_neural.errors import InputError
from warp_neural.imaging.exr import check_header, checked_channels, read_channels, write_file
from warp_neural.io.files import atomic_path

_TILE = 64
_ONE_LEVEL, _MIPMAP = 0, 1
_ROUND_UP = 1


def save_exr_mips(path: Path | str, levels: Sequence[np.ndarray], names: Sequence[str] = ("R", "G", "B")) -> None:
    """Write a mip chain as one EXR: `levels[k]` is `[max(1, height >> k), max(1, width >> k), channels]`, down to 1x1.

    float16, float32 or uint32, stored exactly (ZIP); `names` are the channels' names in order. `[h, w]` is one channel.
    Raises `InputError` for a chain that is incomplete or of other sizes, and as `save_exr` does.
    """
    path = Path(path)
    levels = [level[..., None] if level.ndim == 2 else level for level in levels]
    _check_chain(path, levels, names)
    files = [_pack_level(path, dict(zip(names, np.moveaxis(level, -1, 0), strict=True))) for level in levels]
    header = _Header(files[0])
    header.set_level_mode(_MIPMAP)
    tiles = []
    for k, file in enumerate(files):
        level_header = _Header(file)
        tiles += [_with_level(tile, k) for tile in _tiles(file, level_header.end, level_header.tile_counts()[0])]
    with atomic_path(path) as temporary:
        temporary.write_bytes(_assemble(header.data, tiles))


def load_exr_mips(path: Path | str) -> list[dict[str, np.ndarray]]:
    """The levels of an EXR with mip levels, finest first: each its channels by name, `[height, width]`, as stored.

    Raises `InputError` for an EXR without mip levels and as `load_exr` does.
    """
    path = Path(path)
    check_header(path)
    try:
        data = path.read_bytes()
        header = _Header(data)
        if header.level_mode != _MIPMAP:
            raise InputError(f"{path}: an EXR of one level, without mip levels; read it with load_exr")
        counts = header.tile_counts()
        tiles = iter(_tiles(data, header.end, sum(counts)))
        files = [_level_file(header, k, [next(tiles) for _ in range(count)]) for k, count in enumerate(counts)]
    except (struct.error, ValueError, LookupError, ArithmeticError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: the EXR's mip levels are cut short or damaged; export or copy it again") from error
    return [read_channels(io.BytesIO(file), path) for file in files]


class _Header:
    """An EXR's bytes up to its offset table, which is at `end`, with the few attributes that differ between levels."""

    def __init__(self, data: bytes) -> None:
        at, self.where = 8, {}  # after the magic number and the version
        while data[at] != 0:
            name_end = data.index(b"\0", at)
            type_end = data.index(b"\0", name_end + 1)
            (size,) = struct.unpack_from("<i", data, type_end + 1)
            self.where[data[at:name_end]] = type_end + 5
            at = type_end + 5 + size
            if size < 0 or at >= len(data):
                raise ValueError("header without an end")
        self.end = at + 1
        self.data = bytearray(data[: self.end])

    @property
    def level_mode(self) -> int:
        """One level, mip map or rip map; 0 for a file without tiles."""
        return self.data[self.where[b"tiles"] + 8] & 15 if b"tiles" in self.where else _ONE_LEVEL

    def set_level_mode(self, mode: int) -> None:
        self.data[self.where[b"tiles"] + 8] = mode

    def window(self) -> tuple[int, int, int, int]:
        """xmin, ymin, xmax, ymax of the data window, inclusive."""
        return struct.unpack_from("<4i", self.data, self.where[b"dataWindow"])

    def level_sizes(self) -> list[tuple[int, int]]:
        """(width, height) of every level, finest first."""
        x0, y0, x1, y1 = self.window()
        width, height = x1 - x0 + 1, y1 - y0 + 1
        if self.level_mode == _ONE_LEVEL:
            return [(width, height)]
        up = self.data[self.where[b"tiles"] + 8] >> 4 == _ROUND_UP
        count = (max(width, height) - up).bit_length() + up  # 1 + the logarithm to base 2, rounded either way
        more = [2**k - 1 if up else 0 for k in range(count)]
        return [(max(1, width + more[k] >> k), max(1, height + more[k] >> k)) for k in range(count)]

    def tile_counts(self) -> list[int]:
        """The number of tiles of every level, finest first."""
        across, down = struct.unpack_from("<2I", self.data, self.where[b"tiles"])
        return [-(-width // across) * -(-height // down) for width, height in self.level_sizes()]


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
    write_file(OpenEXR.File(header, checked_channels(path, channels)), out, path)
    return out.getvalue()


def _tiles(data: bytes, table: int, count: int) -> list[bytes]:
    """The `count` packed tiles, each with its five-integer head, by the offset table at `table`."""
    tiles = []
    for (offset,) in struct.iter_unpack("<Q", data[table : table + 8 * count]):
        (size,) = struct.unpack_from("<i", data, offset + 16)
        if size < 0 or offset + 20 + size > len(data):
            raise ValueError("tile beyond the end of the file")
        tiles.append(data[offset : offset + 20 + size])
    if len(tiles) != count:
        raise ValueError("offset table beyond the end of the file")
    return tiles


def _with_level(tile: bytes, k: int) -> bytes:
    return tile[:8] + struct.pack("<2i", k, k) + tile[16:]


def _level_file(header: _Header, k: int, tiles: list[bytes]) -> bytes:
    """Level `k` as a whole EXR of one level."""
    level = _Header(bytes(header.data))
    x0, y0, *_ = header.window()
    width, height = header.level_sizes()[k]
    struct.pack_into("<4i", level.data, level.where[b"dataWindow"], x0, y0, x0 + width - 1, y0 + height - 1)
    level.set_level_mode(_ONE_LEVEL)
    return _assemble(level.data, [_with_level(tile, 0) for tile in tiles])


def _assemble(header: bytes, tiles: list[bytes]) -> bytes:
    """Header, offset table, tiles."""
    first = len(header) + 8 * len(tiles)
    offsets = first + np.cumsum([0] + [len(tile) for tile in tiles[:-1]])
    return bytes(header) + offsets.astype("<u8").tobytes() + b"".join(tiles)
