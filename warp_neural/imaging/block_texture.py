"""Mip chains as GPUs read them: blocks of 4 x 4 texels, or halves, level by level, in memory."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from warp_neural.errors import InputError
from warp_neural.imaging.block_encoders import Quality, encode_blocks

Format = Literal["bc1", "bc3", "bc4", "bc5", "bc7", "half"]
LARGEST_SIDE = 16384
_LARGEST_HALF = 65504


@dataclass(frozen=True)
class BlockFormat:
    """bytes: of a block; side: its texels, 4 or 1; channels: that can be stored in it; srgb: whether it may be so."""

    bytes: int
    side: int
    channels: tuple[int, ...]
    srgb: bool = False


FORMATS = {
    "bc1": BlockFormat(8, 4, (3,), srgb=True),
    "bc3": BlockFormat(16, 4, (4,), srgb=True),
    "bc4": BlockFormat(8, 4, (1,)),
    "bc5": BlockFormat(16, 4, (2,)),
    "bc7": BlockFormat(16, 4, (3, 4), srgb=True),
    "half1": BlockFormat(2, 1, (1,)),
    "half4": BlockFormat(8, 1, (3, 4)),
}
"""half1 and half4: float16 red, or red, green, blue and alpha"""


def level_bytes(format: str, height: int, width: int) -> int:
    side = FORMATS[format].side
    return -(-height // side) * -(-width // side) * FORMATS[format].bytes


@dataclass(frozen=True)
class BlockTexture:
    """format: a name in `FORMATS`. height, width: of level 0, in texels. levels: blocks by rows, each level half as
    large as the one before, rounded down. srgb: codes are encoded so. opaque: alpha, if there is any, means nothing.

    Raises `InputError` for what does not fit together.
    """

    format: str
    height: int
    width: int
    levels: tuple[bytes, ...]
    srgb: bool = False
    opaque: bool = True

    def __post_init__(self) -> None:
        if self.format not in FORMATS:
            raise InputError(f"format={self.format!r}; choose from {', '.join(FORMATS)}")
        if not (0 < self.height <= LARGEST_SIDE and 0 < self.width <= LARGEST_SIDE):
            raise InputError(f"a texture of {self.width} x {self.height}; sides may be 1 to {LARGEST_SIDE}")
        if not 1 <= len(self.levels) <= max(self.height, self.width).bit_length():
            raise InputError(f"{len(self.levels)} mip levels; {self.width} x {self.height} texels have 1 to 1 x 1")
        for mip, level in enumerate(self.levels):
            if len(level) != self.level_bytes(mip):
                raise InputError(f"mip {mip}: {len(level)} bytes; {self.format} has {self.level_bytes(mip)}")
        if self.srgb and not FORMATS[self.format].srgb:
            raise InputError(f"srgb: {self.format} is linear; leave it out")

    def size(self, mip: int) -> tuple[int, int]:
        """(height, width) of a level, in texels."""
        return max(self.height >> mip, 1), max(self.width >> mip, 1)

    def level_bytes(self, mip: int) -> int:
        return level_bytes(self.format, *self.size(mip))


def encode_levels(
    levels: Sequence[np.ndarray], format: Format, srgb: bool = False, quality: Quality = "fast", name: object = "levels"
) -> BlockTexture:
    """A mip chain, each level half as large as the one before, rounded down; any sizes, from one level up.

    levels: float `[height, width, channels]` as stored, see `FORMATS`, clipped to [0, 1] in block formats; srgb: these
    are encoded so, where the format can say it. name: what messages begin with. Raises `InputError` for other shapes,
    NaN and halves beyond 65504.
    """
    levels = [np.asarray(level) for level in levels]
    known = _check(name, levels, format)
    encode = _halves if format == "half" else lambda _name, level: encode_blocks(level, format, quality)
    height, width, channels = levels[0].shape
    blocks = tuple(encode(name, level) for level in levels)
    return BlockTexture(known, height, width, blocks, srgb and FORMATS[known].srgb, opaque=channels != 4)


def _halves(name: object, values: np.ndarray) -> bytes:
    if np.abs(values).max() > _LARGEST_HALF:
        raise InputError(f"{name}: values beyond {_LARGEST_HALF}, the largest half; save it as EXR")
    if values.shape[-1] == 3:
        values = np.concatenate([values, np.ones_like(values[..., :1])], axis=-1)
    return values.astype("<f2").tobytes()


def _check(name: object, levels: list[np.ndarray], format: str) -> str:
    """Returns the format's name in `FORMATS`."""
    first = levels[0].shape if levels else ()
    known = ("half1" if first[-1:] == (1,) else "half4") if format == "half" else format
    if format != "half" and (format not in FORMATS or FORMATS[format].side == 1):
        raise InputError(f"{name}: format={format!r}; choose from bc1, bc3, bc4, bc5, bc7, half")
    channels = (1, 3, 4) if format == "half" else FORMATS[known].channels
    if len(first) != 3 or 0 in first or first[-1] not in channels:
        shape = first if levels else "of no levels"
        raise InputError(f"{name}: an array {shape}; {format} takes [height, width, {channels} channels]")
    height, width, _ = first
    shapes = [(max(height >> k, 1), max(width >> k, 1), first[-1]) for k in range(max(height, width).bit_length())]
    if [level.shape for level in levels] != shapes[: len(levels)]:
        raise InputError(f"{name}: mip levels must halve, rounded down, to 1 x 1 at most: {shapes}")
    if not all(np.isfinite(level).all() for level in levels):
        raise InputError(f"{name}: NaN or infinite values are not saved; repair the picture first")
    return known
