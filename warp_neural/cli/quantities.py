"""What options of textures hold in one word: sizes of files and pictures, maps, their weights, losses, rectangles."""

import re
from collections.abc import Iterable
from typing import Literal, get_args

import numpy as np

from warp_neural.errors import InputError
from warp_neural.kernels.texture.losses import Cost

_UNITS = {"": 1, "b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "kib": 2**10, "mib": 2**20, "gib": 2**30}
_BYTES = re.compile(r"(\d{1,12}(?:\.\d{1,12})?) ?([kmg]?i?b?)", re.IGNORECASE)
_SIDES = re.compile(r"(\d{1,6})x(\d{1,6})", re.IGNORECASE)


def bytes_of(option: str, text: str) -> int:
    """`400kB`, `1.5 MiB` or `400000`, at least 1."""
    match = _BYTES.fullmatch(text.strip())
    size = int(float(match[1]) * _UNITS[match[2].lower()]) if match and match[2].lower() in _UNITS else 0
    if size < 1:
        raise InputError(f"{option} {text}: give a size such as 400kB (of 1000 bytes) or 400KiB (of 1024)")
    return size


def sides_of(option: str, text: str) -> tuple[int, int] | Literal["largest"]:
    """`1024x512`, width and height, or `largest`."""
    if text == "largest":
        return "largest"
    match = _SIDES.fullmatch(text.strip())
    if not match:
        raise InputError(f"{option} {text}: give width and height, as in 1024x512, or largest")
    return int(match[1]), int(match[2])


def names_of(text: str | None) -> tuple[str, ...] | None:
    """`albedo,normal`; None stays."""
    return None if text is None else tuple(name for part in text.split(",") if (name := part.strip()))


def weights_of(option: str, text: str | None, names: Iterable[str]) -> dict[str, float] | None:
    """`albedo=2,normal=1`, of maps called `names`; None stays."""
    if text is None:
        return None
    weights = {}
    for part in text.split(","):
        name, equals, number = map(str.strip, part.partition("="))
        if name not in names:
            raise InputError(f"{option} {text}: no map {name!r}; there are {', '.join(names)}")
        try:
            weights[name] = float(number)
        except ValueError:
            weights[name] = np.nan
        if not equals or not 0 <= weights[name] <= 1e6:
            raise InputError(f"{option} {text}: give maps and numbers from 0 to 1e6, as in albedo=2,normal=1")
    return weights


def losses_of(option: str, text: str | None) -> dict[str, Cost] | None:
    """`normal=angle,albedo=luminance`; None stays."""
    if text is None:
        return None
    pairs = [tuple(map(str.strip, part.partition("="))) for part in text.split(",")]
    if not all(cost in get_args(Cost) for _, _, cost in pairs):
        costs = ", ".join(get_args(Cost))
        raise InputError(f"{option} {text}: give maps and one of {costs}, as in normal=angle,albedo=luminance")
    return {name: cost for name, _, cost in pairs}


def level_of(option: str, text: str, levels: int) -> int | Literal["all"]:
    """`all`, or the number of one of a texture's mip levels."""
    if text == "all":
        return "all"
    if not text.isdecimal() or len(text) > 4 or int(text) >= levels:
        raise InputError(f"{option} {text}: give 0 to {levels - 1}, or all")
    return int(text)


def rectangle_of(option: str, text: str | None, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    """`X,Y,W,H` in texels inside of a level of `size` (height, width); None stays."""
    if text is None:
        return None
    parts, (height, width) = [part.strip() for part in text.split(",")], size
    if len(parts) != 4 or not all(part.isdecimal() and len(part) < 7 for part in parts):
        raise InputError(f"{option} {text}: give left, top, width and height in texels, as in 0,0,256,256")
    x, y, w, h = map(int, parts)
    if w < 1 or h < 1 or x + w > width or y + h > height:
        raise InputError(f"{option} {text}: does not lie in the {width} x {height} texels of this mip level")
    return x, y, w, h
