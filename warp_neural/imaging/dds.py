"""DDS files: textures with all mip levels in the block formats that GPUs read, or in halves.

Microsoft, "Programming Guide for DDS", with the DX10 header. etcpak compresses colours, BC1 and BC3 within
milliseconds, BC7 (modes 1, 5, 6 and 7) in about two seconds a megatexel. Its BC4 and BC5 are 2 to 4 dB below what the
formats can, so these are made here.
"""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import etcpak
import numpy as np

from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path

Format = Literal["bc1", "bc3", "bc4", "bc5", "bc7", "half"]

CHANNELS = {"bc1": (3,), "bc3": (4,), "bc4": (1,), "bc5": (2,), "bc7": (3, 4), "half": (1, 3, 4)}
"""that each format holds"""

_DXGI = {"bc1": 71, "bc3": 77, "bc4": 80, "bc5": 83, "bc7": 98}
_SRGB = ("bc1", "bc3", "bc7")  # the next number is that format with sRGB's encoding
_HALF_RGBA, _HALF_RED = 10, 54
_CAPS, _PITCH, _MIP_COUNT, _LINEAR_SIZE = 0x1007, 0x8, 0x20000, 0x80000  # caps, height, width and format are valid
_TEXTURE, _OF_MANY_LEVELS = 0x1000, 0x400008
_STRAIGHT, _OPAQUE = 1, 3  # alpha; BC7's may be 254 where there is none
_LARGEST_HALF = 65504


def save_dds(path: Path | str, levels: Sequence[np.ndarray], format: Format, srgb: bool = False) -> None:
    """Write a mip chain, each level half as large as the one before, rounded down; any sizes, from one level up.

    levels: float `[height, width, channels]` as stored, see `CHANNELS`, clipped to [0, 1] in block formats; srgb: these
    are encoded so. Raises `InputError` for other shapes, NaN, halves beyond 65504, or if not writable.
    """
    path = Path(path)
    levels = [np.asarray(level) for level in levels]
    _check(path, levels, format)
    pieces = [_half(path, level) if format == "half" else encode_blocks(level, format) for level in levels]
    channels = levels[0].shape[-1]
    dxgi = (
        (_HALF_RED if channels == 1 else _HALF_RGBA) if format == "half" else _DXGI[format] + (srgb and format in _SRGB)
    )
    height, width = levels[0].shape[:2]
    flags = _CAPS | _MIP_COUNT | (_PITCH if format == "half" else _LINEAR_SIZE)
    size = len(pieces[0]) // height if format == "half" else len(pieces[0])
    caps = _TEXTURE | (_OF_MANY_LEVELS if len(levels) > 1 else 0)
    header = struct.pack("<4s7I44x", b"DDS ", 124, flags, height, width, size, 0, len(levels))
    header += struct.pack("<2I4s20x", 32, 4, b"DX10") + struct.pack("<I16x", caps)
    header += struct.pack("<5I", dxgi, 3, 0, 1, _STRAIGHT if channels == 4 else _OPAQUE)  # one, of two dimensions
    with atomic_path(path) as temporary:
        temporary.write_bytes(header + b"".join(pieces))


def encode_blocks(values: np.ndarray, format: Format) -> bytes:
    """Floats in [0, 1] `[height, width, channels]` to blocks of 4 x 4 texels, by rows; edges are repeated outwards."""
    height, width, channels = values.shape
    codes = np.full((height, width, 4), 255, np.uint8)
    codes[..., :channels] = np.rint(np.clip(values, 0, 1) * 255)
    codes = np.pad(codes, ((0, -height % 4), (0, -width % 4), (0, 0)), mode="edge")
    if format in ("bc4", "bc5"):
        parts = [_single_channel(codes[..., channel]) for channel in range(CHANNELS[format][0])]
        return np.stack(parts, axis=1).astype("<u8").tobytes()
    options = (etcpak.BC7CompressBlockParams(),) if format == "bc7" else ()
    encode = getattr(etcpak, f"compress_{format}")
    return encode(codes.tobytes(), codes.shape[1], codes.shape[0], *options)  # a copy: it may change what it is given


def _single_channel(codes: np.ndarray) -> np.ndarray:
    """BC4 blocks of uint8 `[height, width]`, uint64 `[blocks]`: from the largest code to the smallest in 7 steps.

    A block is both ends, then the texels' indices of 3 bits by rows: 0 and 1 are the ends, 2 to 7 lie between them.
    """
    height, width = codes.shape
    texels = codes.reshape(height // 4, 4, width // 4, 4).swapaxes(1, 2).reshape(-1, 16).astype(np.uint64)
    most, least = texels.max(axis=1), texels.min(axis=1)
    span = np.maximum(most - least, 1)[:, None]
    steps = (14 * (most[:, None] - texels) + span) // (2 * span)  # rounded, 0 to 7
    indices = np.array([0, 2, 3, 4, 5, 6, 7, 1], np.uint64)[steps.astype(np.intp)]
    shifts = np.arange(16, 64, 3, dtype=np.uint64)
    return most | least << np.uint64(8) | np.bitwise_or.reduce(indices << shifts, axis=1)


def _half(path: Path, values: np.ndarray) -> bytes:
    if np.abs(values).max() > _LARGEST_HALF:
        raise InputError(f"{path}: values beyond {_LARGEST_HALF}, the largest half; save it as EXR")
    if values.shape[-1] == 3:
        values = np.concatenate([values, np.ones_like(values[..., :1])], axis=-1)
    return values.astype("<f2").tobytes()


def _check(path: Path, levels: list[np.ndarray], format: Format) -> None:
    if format not in CHANNELS:
        raise InputError(f"{path}: format={format!r}; choose from {', '.join(CHANNELS)}")
    if not levels or levels[0].ndim != 3 or 0 in levels[0].shape or levels[0].shape[-1] not in CHANNELS[format]:
        shape = levels[0].shape if levels else "of no levels"
        raise InputError(f"{path}: an array {shape}; {format} takes [height, width, {CHANNELS[format]} channels]")
    height, width, channels = levels[0].shape
    shapes = [(max(height >> k, 1), max(width >> k, 1), channels) for k in range(max(height, width).bit_length())]
    if [level.shape for level in levels] != shapes[: len(levels)]:
        raise InputError(f"{path}: mip levels must halve, rounded down, to 1 x 1 at most: {shapes}")
    if not all(np.isfinite(level).all() for level in levels):
        raise InputError(f"{path}: NaN or infinite values are not saved; repair the picture first")
