"""A texture set: the maps of a material, or any pictures of one size, as the channels that one network learns."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.ndimage import maximum_filter

from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import LARGEST_CHANNELS, LARGEST_SIDE
from warp_neural.texture.kinds import clipped, describe, kind_of, to_network, trimmed, varying
from warp_neural.texture.pictures import Picture, pictures_of
from warp_neural.texture.resample import mip_levels, resample
from warp_neural.texture.state import Kind, Map

_SEEN = 1 / 510  # an opacity that 8 bits have as 0 is not
Resize = tuple[int, int] | Literal["largest"]


@dataclass(frozen=True)
class TextureSet:
    """Maps and their values as the network is to have them."""

    name: str
    maps: tuple[Map, ...]
    levels: tuple[np.ndarray, ...]
    """float32 [height, width, channels that vary, of all maps], in [0, 1], finest first; one unless mip levels are
    given"""
    unused: tuple[str, ...] = ()
    """names of the pictures of the folder that are in no map"""

    @property
    def values(self) -> np.ndarray:
        """The finest level."""
        return self.levels[0]

    @property
    def size(self) -> tuple[int, int]:
        """(height, width), in texels."""
        return self.values.shape[:2]

    @property
    def channels(self) -> int:
        return self.values.shape[-1]


def load_set(source: Any, maps: Sequence[str] | None = None, resize: Resize | None = None) -> TextureSet:
    """A folder, a list of files, a dict of arrays or a `Material` (see `pictures_of`) as a texture set.

    maps: the names of those to take. resize: (width, height) of all, or "largest", that of the picture with the most
    texels; smaller by the area filter, larger by a cubic. A channel of one value is no channel of the network, but
    where all are, the first is. Raises `InputError` for pictures that cannot be read, of unequal sizes without
    `resize`, too large, or of more than 16 channels that vary.
    """
    if isinstance(source, TextureSet):
        if maps or resize:
            raise InputError("a TextureSet has its maps and size; choose them where it is made")
        return source
    pictures, unused = pictures_of(source, maps)
    if not pictures:
        raise InputError("no maps; give one at least")
    pictures = [trimmed(picture) for picture in pictures]
    kinds = {picture.name: kind_of(picture) for picture in pictures}
    pictures = [clipped(picture, kinds[picture.name]) for picture in pictures]
    name = Path(source).resolve().name if isinstance(source, str | Path) else getattr(source, "name", "")
    where = str(source) if isinstance(source, str | Path) else name or "the maps"
    if resize:
        pictures = _resized(where, pictures, kinds, resize)
    _check_sizes(where, pictures)
    found = [describe(picture, kinds[picture.name]) for picture in pictures]
    if not any(each.trained for each in found):
        found[0] = varying(found[0])
    _check_channels(where, found)
    levels = zip(*(picture.levels for picture in pictures), strict=True)
    values = tuple(_stacked(level, found) for level in levels)
    return TextureSet(name, tuple(found), values, unused)


def mip_chain(texture_set: TextureSet, levels: int | None = None) -> tuple[np.ndarray, ...]:
    """`levels` mip levels, all if None, the finest first: those that are given, then filtered ones.

    Float32 [max(height >> m, 1), max(width >> m, 1), channels] in [0, 1]. Colours are averaged as linear light,
    normals as vectors that are made unit length again, masks become coverage. Raises `InputError` for too many levels.
    """
    height, width = texture_set.size
    most = max(height, width).bit_length()
    count = most if levels is None else levels
    if not 1 <= count <= most:
        raise InputError(f"{count} mip levels: {width} x {height} texels have 1 to {most}")
    given = texture_set.levels[:count]
    return *given, *mip_levels(given[-1], texture_set.maps, count - len(given))


def without_hidden(levels: Sequence[np.ndarray], maps: Sequence[Map]) -> list[np.ndarray]:
    """Copies of mip levels with NaN, which stands for any value, in all maps where the mask "opacity" is 0.

    But not in the texels beside those that are seen: filtering reads them. Levels as they are without such a mask.
    """
    places = np.cumsum([0, *(len(each.trained) for each in maps)])
    masks = [k for k, each in zip(places, maps, strict=False) if (each.name, each.kind) == ("opacity", "mask")]
    if not masks or masks[0] == places[-1]:
        return list(levels)
    return [_with_nan(level, masks[0]) for level in levels]


def _with_nan(level: np.ndarray, mask: int) -> np.ndarray:
    seen = maximum_filter(level[..., mask], size=3, mode="wrap") >= _SEEN
    result = np.where(seen[..., None], level, np.float32(np.nan))
    result[..., mask] = level[..., mask]
    return result


def _stacked(level: Sequence[np.ndarray], maps: Sequence[Map]) -> np.ndarray:
    return np.concatenate([to_network(values, each) for values, each in zip(level, maps, strict=True)], axis=-1)


def _resized(where: str, pictures: list[Picture], kinds: dict[str, Kind], resize: Resize) -> list[Picture]:
    if any(len(picture.levels) > 1 for picture in pictures):
        raise InputError(f"{where}: mip levels that are given are not resized; leave --resize out")
    if resize == "largest":
        width, height = max((_size(picture) for picture in pictures), key=np.prod)
    else:
        width, height = resize
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
        raise InputError(f"--resize {width}x{height}: give sides of 1 to {LARGEST_SIDE}")
    return [_scaled(picture, kinds[picture.name], (height, width)) for picture in pictures]


def _scaled(picture: Picture, kind: Kind, size: tuple[int, int]) -> Picture:
    if picture.levels[0].shape[:2] == size:
        return picture
    (values,) = picture.levels
    return Picture(picture.name, picture.of, (resample(values, kind, size),), picture.file, picture.bits)


def _size(picture: Picture) -> tuple[int, int]:
    height, width = picture.levels[0].shape[:2]
    return width, height


def _check_sizes(where: str, pictures: list[Picture]) -> None:
    sizes = {picture.file or picture.name: _size(picture) for picture in pictures}
    width, height = max(sizes.values(), key=np.prod)
    if len(set(sizes.values())) > 1:
        each = ", ".join(f"{name} {w} x {h}" for name, (w, h) in sizes.items())
        raise InputError(
            f"{where}: maps of unequal sizes, {each}; give --resize largest, or a size as in --resize {width}x{height}"
        )
    if max(width, height) > LARGEST_SIDE:
        raise InputError(f"{where}: {width} x {height} texels; at most {LARGEST_SIDE} a side, scale it by --resize")
    for picture in pictures:
        for k, level in enumerate(picture.levels):
            expected = max(height >> k, 1), max(width >> k, 1)
            channels = picture.levels[0].shape[-1]
            if level.shape != (*expected, channels):
                raise InputError(
                    f"{where}: level_{k}, {picture.file or picture.name}: {level.shape[1]} x {level.shape[0]} texels, "
                    f"{level.shape[2]} channels; levels halve, rounded down: {expected[1]} x {expected[0]}, {channels}"
                )


def _check_channels(where: str, maps: list[Map]) -> None:
    count = sum(len(each.trained) for each in maps)
    if count > LARGEST_CHANNELS:
        each = ", ".join(f"{each.name} {len(each.trained)}" for each in maps if each.trained)
        raise InputError(
            f"{where}: {count} channels ({each}); at most {LARGEST_CHANNELS} in one texture: name fewer with --maps, "
            "or compress in two files"
        )
