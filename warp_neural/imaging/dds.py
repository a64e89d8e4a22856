"""DDS files: textures with all mip levels in the block formats that GPUs read, or in halves.

Microsoft, "Programming Guide for DDS", with the DX10 header; older ones are read too. Header, then the levels, the
finest first.
"""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.imaging.block_encoders import Quality
from warp_neural.imaging.block_texture import FORMATS, LARGEST_SIDE, BlockTexture, Format, encode_levels, level_bytes
from warp_neural.io.files import atomic_path

MAGIC = b"DDS "
_DXGI = {"bc1": 71, "bc3": 77, "bc4": 80, "bc5": 83, "bc7": 98, "half1": 54, "half4": 10}  # the next one: sRGB
_NAMED = {b"DXT1": "bc1", b"DXT5": "bc3", b"ATI1": "bc4", b"BC4U": "bc4", b"ATI2": "bc5", b"BC5U": "bc5"}
_CAPS, _PITCH, _MIP_COUNT, _LINEAR_SIZE = 0x1007, 0x8, 0x20000, 0x80000  # caps, height, width and format are valid
_TEXTURE, _OF_MANY_LEVELS, _CUBE_OR_VOLUME = 0x1000, 0x400008, 0x20FE00
_STRAIGHT, _OPAQUE = 1, 3  # alpha; BC7's may be 254 where there is none
_HEADER = "<4s7I44x2I4s20x2I12x"  # magic, size, flags, height, width, bytes, depth, levels; 32, 4, name; caps
_DX10 = "<5I"


def save_dds(
    path: Path | str, levels: Sequence[np.ndarray], format: Format, srgb: bool = False, quality: Quality = "fast"
) -> None:
    """Encode a mip chain (see `encode_levels`) and write it. Raises `InputError`, as `write_dds` does."""
    write_dds(path, encode_levels(levels, format, srgb, quality, name=path))


def write_dds(path: Path | str, texture: BlockTexture) -> None:
    """Blocks as they are. Raises `InputError` if not writable."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(dds_bytes(texture))


def dds_bytes(texture: BlockTexture) -> bytes:
    """The content of its file."""
    halves = FORMATS[texture.format].side == 1
    size = len(texture.levels[0]) // (texture.height if halves else 1)
    flags = _CAPS | _MIP_COUNT | (_PITCH if halves else _LINEAR_SIZE)
    caps = _TEXTURE | (_OF_MANY_LEVELS if len(texture.levels) > 1 else 0)
    sizes = texture.height, texture.width, size, 0, len(texture.levels)
    header = struct.pack(_HEADER, MAGIC, 124, flags, *sizes, 32, 4, b"DX10", caps, 0)
    dxgi = _DXGI[texture.format] + texture.srgb
    header += struct.pack(_DX10, dxgi, 3, 0, 1, _OPAQUE if texture.opaque else _STRAIGHT)  # one, of two dimensions
    return header + b"".join(texture.levels)


def parse_dds(data: bytes) -> BlockTexture:
    """Of a whole file. Raises `InputError` for one that is damaged, longer than it says, or holds something else."""
    try:
        return _parse(data)
    except struct.error:
        raise InputError("it ends within its header; it is damaged") from None


def _parse(data: bytes) -> BlockTexture:
    magic, size, _flags, height, width, _bytes, depth, count, pixel, kind, name, _caps, cube = struct.unpack_from(
        _HEADER, data
    )
    if (magic, size, pixel) != (MAGIC, 124, 32) or not kind & 4:
        raise InputError("no DDS file of a block format; give one of BC1, BC3, BC4, BC5, BC7 or halves")
    if depth > 1 or cube & _CUBE_OR_VOLUME:
        raise InputError("a cube or volume; give a texture of two dimensions")
    at, srgb, opaque = struct.calcsize(_HEADER), False, name != b"DXT5"
    format = _NAMED.get(name)
    if name == b"DX10":
        dxgi, dimensions, misc, array, alpha = struct.unpack_from(_DX10, data, at)
        at += struct.calcsize(_DX10)
        if (dimensions, misc, array) != (3, 0, 1):
            raise InputError("an array, cube or volume; give one texture of two dimensions")
        format = next((key for key, value in _DXGI.items() if dxgi in (value, value + FORMATS[key].srgb)), None)
        srgb, opaque = format is not None and dxgi > _DXGI[format], alpha == _OPAQUE or format in ("bc1", "half1")
        name = dxgi
    if format is None:
        raise InputError(f"format {name!r}; give one of BC1, BC3, BC4, BC5, BC7 or halves")
    return BlockTexture(format, height, width, _levels(format, height, width, max(count, 1), data[at:]), srgb, opaque)


def _levels(format: str, height: int, width: int, count: int, data: bytes) -> tuple[bytes, ...]:
    """The finest first, one after the other, and nothing else."""
    levels, at = [], 0
    for mip in range(min(count, LARGEST_SIDE.bit_length())):
        size = level_bytes(format, max(height >> mip, 1), max(width >> mip, 1))
        levels.append(data[at : at + size])
        at += size
    if at != len(data) or len(levels) != count:
        raise InputError(f"{len(data)} bytes of {count} mip levels of {width} x {height}; it is damaged")
    return tuple(levels)
