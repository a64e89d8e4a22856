"""The header of a `.wntc` file: what the texture consists of and what its channels mean; docs/wntc.md."""

import json
import math
import zlib
from collections.abc import Mapping
from typing import Any, NamedTuple, get_args

from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import KERNELS, Grid, TextureSpec
from warp_neural.texture.sections import Reader
from warp_neural.texture.state import Kind, Map

MOST_TEXT = 2**24  # bytes of the JSON


class Header(NamedTuple):
    spec: TextureSpec
    block: int
    """texels of a block's side"""
    maps: tuple[Map, ...]
    extra: Mapping[str, Any]


def pack(header: Header) -> bytes:
    """Raises `InputError` for extra data that JSON cannot hold, or not in 16 MiB."""
    spec = header.spec
    sizes = spec.height.to_bytes(2, "little") + spec.width.to_bytes(2, "little")
    numbers = [spec.channels, spec.mips, header.block.bit_length() - 1, len(spec.grids)]
    for grid in spec.grids:
        numbers += [grid.scale.bit_length() - 1, grid.channels, KERNELS.index(grid.kernel), grid.bits]
    numbers += [len(spec.hidden), *(width - 1 for width in spec.hidden)]
    try:
        text = json.dumps(
            [maps_to_json(header.maps), dict(header.extra)], separators=(",", ":"), allow_nan=False
        ).encode()
    except (TypeError, ValueError) as error:
        raise InputError(f"extra: cannot be written as JSON ({error}); use plain, finite values") from error
    if len(text) > MOST_TEXT:
        raise InputError(f"extra: {len(text)} bytes as JSON, more than the {MOST_TEXT} of a texture; keep less with it")
    return sizes + bytes(numbers) + zlib.compress(text, 9)


def unpack(reader: Reader) -> Header:
    """Raises `InputError` naming the file."""
    height, width = (int.from_bytes(reader.bytes(2), "little") for _ in range(2))
    channels, mips, block, count = reader.bytes(4)
    grids = [reader.bytes(4) for _ in range(count)]
    hidden = [width + 1 for width in reader.bytes(reader.byte())]
    reader.require(all(grid[0] < 6 and grid[2] < len(KERNELS) for grid in grids), "a grid is unknown")
    try:
        parts = [Grid(1 << scale, channels, KERNELS[kernel], bits) for scale, channels, kernel, bits in grids]
        spec = TextureSpec(height, width, channels, mips, tuple(parts), tuple(hidden))
    except InputError as error:
        raise InputError(f"{reader.path}: header: {error}") from error
    reader.require(5 <= block <= 8, "blocks of an unknown size")
    maps, extra = _text(reader)
    return Header(spec, 1 << block, maps, extra)


def _text(reader: Reader) -> tuple[tuple[Map, ...], dict]:
    problem = "maps cannot be read"
    try:
        inflate = zlib.decompressobj()
        text = inflate.decompress(reader.rest(), MOST_TEXT)
        reader.require(inflate.eof and not inflate.unused_data, problem)
        maps, extra = json.loads(text)
        maps = maps_of_json(maps)
    except (zlib.error, ValueError, TypeError, RecursionError):
        reader.require(False, problem)
    reader.require(isinstance(extra, dict), problem)
    return maps, extra


def maps_to_json(maps: tuple[Map, ...]) -> list:
    """JSON."""
    return [[each.name, each.kind, each.low, each.high, each.file, each.bits] for each in maps]


def maps_of_json(values: list) -> tuple[Map, ...]:
    """Of JSON. Raises ValueError or TypeError for any other than that of `maps_to_json`."""
    maps = tuple(Map(name, kind, tuple(low), tuple(high), *rest) for name, kind, low, high, *rest in values)
    if not all(map(_is_whole, maps)):
        raise ValueError("maps cannot be read")
    return maps


def _is_whole(each: Map) -> bool:
    numbers = (*each.low, *each.high)
    finite = all(type(x) in (int, float) and math.isfinite(x) for x in numbers)
    texts = isinstance(each.name, str) and isinstance(each.file, str) and each.kind in get_args(Kind)
    return finite and texts and each.bits in (8, 16) and 0 < len(each.low) == len(each.high)
