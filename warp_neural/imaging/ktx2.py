"""KTX 2.0 files: textures with all mip levels in the block formats that GPUs read, or in halves.

Khronos, "KTX File Format Specification", version 2.0, and, for the descriptor, "Khronos Data Format Specification",
version 1.3. Header, index of the levels, descriptor, keys and values, then the levels, the smallest first. Without
supercompression. They do not say whether alpha means something: read, it does, where the format has it.
"""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.imaging.block_encoders import Quality
from warp_neural.imaging.block_texture import FORMATS, LARGEST_SIDE, BlockTexture, Format, encode_levels
from warp_neural.io.files import atomic_path

MAGIC = b"\xabKTX 20\xbb\r\n\x1a\n"
_VULKAN = {"bc1": 131, "bc3": 137, "bc4": 139, "bc5": 141, "bc7": 145, "half1": 76, "half4": 97}  # the next one: sRGB
_BC1_WITH_ALPHA = 133
_MODELS = {"bc1": 128, "bc3": 130, "bc4": 131, "bc5": 132, "bc7": 134, "half1": 1, "half4": 1}
_ALPHA, _LINEAR_ALPHA, _SIGNED_FLOAT = 15, 0x10, 0xC0  # channels and what is said of them
_CHANNELS = {"bc3": (_ALPHA, 0), "bc5": (0, 1), "half4": (0, 1, 2, _ALPHA)}  # in the order of their bits; else one
_BT709, _LINEAR, _SRGB = 1, 1, 2
_HEADER, _LEVEL = "<12s9I4I2Q", "<3Q"
_WRITER = b"KTXwriter\0Warp Neural\0"


def save_ktx2(
    path: Path | str, levels: Sequence[np.ndarray], format: Format, srgb: bool = False, quality: Quality = "fast"
) -> None:
    """Encode a mip chain (see `encode_levels`) and write it. Raises `InputError`, as `write_ktx2` does."""
    write_ktx2(path, encode_levels(levels, format, srgb, quality, name=path))


def write_ktx2(path: Path | str, texture: BlockTexture) -> None:
    """Blocks as they are. Raises `InputError` if not writable."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(_file(texture))


def _file(texture: BlockTexture) -> bytes:
    format, count = FORMATS[texture.format], len(texture.levels)
    descriptor = _descriptor(texture.format, texture.srgb)
    writer = struct.pack("<I", len(_WRITER)) + _WRITER + bytes(-len(_WRITER) % 4)
    at = struct.calcsize(_HEADER) + count * struct.calcsize(_LEVEL)
    places = at, len(descriptor), at + len(descriptor), len(writer), 0, 0  # no supercompression's data
    sizes = texture.width, texture.height, 0, 0, 1, count, 0  # no depth, no array, one face; no supercompression
    code = _VULKAN[texture.format] + texture.srgb
    file = struct.pack(_HEADER, MAGIC, code, _type_size(texture.format), *sizes, *places)
    end, index, levels = at + len(descriptor) + len(writer), b"", b""
    for level in reversed(texture.levels):
        gap = bytes(-(end + len(levels)) % max(format.bytes, 4))
        index = struct.pack(_LEVEL, end + len(levels + gap), len(level), len(level)) + index
        levels += gap + level
    return file + index + descriptor + writer + levels


def parse_ktx2(data: bytes) -> BlockTexture:
    """Of a whole file. Raises `InputError` for one that is damaged, longer than it says, or holds something else."""
    try:
        return _parse(data)
    except struct.error:
        raise InputError("it ends within its header; it is damaged") from None


def _parse(data: bytes) -> BlockTexture:
    magic, code, size, width, height, depth, layers, faces, count, scheme, *places = struct.unpack_from(_HEADER, data)
    if magic != MAGIC:
        raise InputError("no KTX 2.0 file; give one of BC1, BC3, BC4, BC5, BC7 or halves")
    if (depth, layers, faces) != (0, 0, 1):
        raise InputError("an array, cube or volume; give one texture of two dimensions")
    if scheme:
        raise InputError(f"supercompression {scheme}; write it without")
    plain = code - 2 if code in (_BC1_WITH_ALPHA, _BC1_WITH_ALPHA + 1) else code
    format = next((key for key, value in _VULKAN.items() if plain in (value, value + FORMATS[key].srgb)), None)
    if format is None:
        raise InputError(f"format {code} of Vulkan; give one of BC1, BC3, BC4, BC5, BC7 or halves")
    srgb, count = plain > _VULKAN[format], max(count, 1)
    if size != _type_size(format) or count > LARGEST_SIDE.bit_length():
        raise InputError(f"{count} mip levels, numbers of {size} bytes; it is damaged")
    start = struct.calcsize(_HEADER) + count * struct.calcsize(_LEVEL)
    _check_sections(data, places, start, format, srgb)
    levels = _levels(data, count, max(places[0] + places[1], places[2] + places[3]), max(FORMATS[format].bytes, 4))
    return BlockTexture(format, height, width, levels, srgb, opaque=format not in ("bc3", "bc7", "half4"))


def _check_sections(data: bytes, places: list[int], start: int, format: str, srgb: bool) -> None:
    """That descriptor, keys and values lie one after the other, and that the descriptor says what the format does."""
    at, size, keys, keys_size, others, others_size = places
    follows = (keys == at + size and keys % 4 == 0) if keys_size else keys == 0
    if at != start or not follows or at + size + keys_size > len(data) or others or others_size:
        raise InputError("its sections do not follow each other; it is damaged")
    free = (13, 15, 31) if format == "bc1" else (13, 15)  # primaries, premultiplied or not, BC1 with alpha or not
    found, expected = bytearray(data[at : at + size]), bytearray(_descriptor(format, srgb))
    if len(found) == len(expected):
        for k in free:
            found[k] = expected[k]
    if found != expected:
        raise InputError(f"its descriptor is not that of {format}; it is damaged")


def _levels(data: bytes, count: int, end: int, alignment: int) -> tuple[bytes, ...]:
    """The finest first; they must lie the smallest first, aligned, without gaps, to the end of the file."""
    levels = []
    for mip in reversed(range(count)):
        at, size, plain = struct.unpack_from(_LEVEL, data, struct.calcsize(_HEADER) + mip * struct.calcsize(_LEVEL))
        end += -end % alignment
        if at != end or size != plain or at + size > len(data):
            raise InputError(f"mip {mip} is not where it must be; it is damaged")
        levels.append(data[at : at + size])
        end += size
    if end != len(data):
        raise InputError(f"{len(data)} bytes in place of {end}; it is damaged")
    return tuple(levels[::-1])


def _type_size(format: str) -> int:
    return 2 if FORMATS[format].side == 1 else 1


def _descriptor(format: str, srgb: bool) -> bytes:
    """Of the data format: the whole section, one basic block with a sample for each channel or group of channels."""
    block, halves = FORMATS[format], FORMATS[format].side == 1
    channels = _CHANNELS.get(format, (0,))
    bits = 8 * block.bytes // len(channels)
    size = 24 + 16 * len(channels)
    descriptor = struct.pack("<2I2H", 4 + size, 0, 2, size)
    descriptor += struct.pack("<4B", _MODELS[format], _BT709, _SRGB if srgb else _LINEAR, 0)
    descriptor += struct.pack("<4B8B", block.side - 1, block.side - 1, 0, 0, block.bytes, *7 * [0])
    low, high = (0xBF800000, 0x3F800000) if halves else (0, 0xFFFFFFFF)  # -1.0 and 1.0
    for k, channel in enumerate(channels):
        said = _SIGNED_FLOAT if halves else _LINEAR_ALPHA if srgb and channel == _ALPHA else 0
        descriptor += struct.pack("<H2B3I", k * bits, bits - 1, channel | said, 0, low, high)
    return descriptor
