"""What the numbers of a picture mean: its kind, and the range that the network has as 0 to 1."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from warp_neural.errors import InputError
from warp_neural.materials.material import RINGING
from warp_neural.texture.pictures import FLOATS, Picture
from warp_neural.texture.state import Kind, Map

_COLOUR = re.compile(r"colou?r|albedo|diffuse|emissi(ve|on)|photo|tint", re.IGNORECASE)
_MASK = re.compile(r"mask\d*$", re.IGNORECASE)
_SCALARS = ("roughness", "metalness", "ao", "height", "opacity")
_GREY = 2 / 255  # how far channels of a scalar map may differ that was grey before a lossy format
_BINARY = 0.98  # of a mask's texels are 0 or 1; the others are its smooth edge
_DARK = 1 / 64  # of the median: darker than this, hdr's errors count as differences, above as ratios
_LARGEST = 1e18  # float32 holds its square
_BITS_OF_HDR = 24  # below the largest value, at most


def trimmed(picture: Picture) -> Picture:
    """Grey stored as RGB as one channel; without an alpha that is 1 everywhere."""
    levels = picture.levels
    if levels[0].shape[-1] == 4 and all((level[..., 3] == 1).all() for level in levels):
        levels = tuple(level[..., :3] for level in levels)
    if levels[0].shape[-1] >= 3 and picture.of != "normal":
        tolerance = _GREY * 1.001 if picture.of in _SCALARS else 0
        pairs = ((level[..., a], level[..., b]) for a, b in ((0, 1), (1, 2), (0, 2)) for level in levels)
        if all(np.abs(x - y).max() <= tolerance for x, y in pairs):
            levels = tuple(level[..., [1, *range(3, level.shape[-1])]] for level in levels)
    return replace(picture, levels=levels)


def kind_of(picture: Picture) -> Kind:
    """By the map that it is, its name, its file's numbers, in this order; see `Map`.

    Floats are hdr if they are colours, or none of a material's other maps and go beyond 1.
    """
    channels = picture.levels[0].shape[-1]
    low, high = _extent(picture.levels)
    if max(-low, high) > _LARGEST:
        raise InputError(f"{picture.file or picture.name}: values from {low:.4g} to {high:.4g}; bring them below 1e18")
    colour = picture.of == "albedo" or (picture.of is None and bool(_COLOUR.search(picture.name)))
    if picture.of == "normal" and channels >= 3 and low >= -RINGING and high <= 1 + RINGING:
        return "normal"
    if channels == 1 and (picture.of == "opacity" or _MASK.search(picture.name)) and _is_binary(picture.levels[0]):
        return "mask"
    if picture.bits == FLOATS and (colour or (picture.of is None and (channels >= 3 or (high > 1 and low >= 0)))):
        if low < -RINGING * high:
            raise InputError(
                f"{picture.file or picture.name}: colours from {low:.4g} to {high:.4g}; clip the negative ones"
            )
        return "hdr"
    return "srgb" if colour else "linear"


def clipped(picture: Picture, kind: Kind) -> Picture:
    """Within what the kind can hold: what lossy EXRs leave outside goes."""
    limits = {"normal": (0, 1), "hdr": (0, None)}.get(kind)
    return replace(picture, levels=tuple(np.clip(level, *limits) for level in picture.levels)) if limits else picture


def describe(picture: Picture, kind: Kind) -> Map:
    """low, high: 0 and 1, or all of the values where they go beyond; of hdr from 2^low, a 64th of the median, up."""
    least = [min(float(level[..., c].min()) for level in picture.levels) for c in _channels(picture)]
    most = [max(float(level[..., c].max()) for level in picture.levels) for c in _channels(picture)]
    low, high = (0.0, 1.0) if min(least) >= 0 and max(most) <= 1 else (min(least), max(most))
    if kind == "hdr":
        low, high = _logarithms(picture.levels[0], max(most))
    ranges = [(a, b) if a == b else (low, high) for a, b in zip(least, most, strict=True)]
    bits = min(picture.bits, 16)
    return Map(picture.name, kind, *zip(*ranges, strict=True), file=picture.file, bits=bits)


def varying(each: Map) -> Map:
    """A map of constant channels with its first one made a result of the network."""
    value = each.low[0]
    low, high = _logarithms(np.float32(value), value) if each.kind == "hdr" else (min(value, 0.0), max(value, 1.0))
    return replace(each, low=(low, *each.low[1:]), high=(high, *each.high[1:]))


def to_network(values: np.ndarray, each: Map) -> np.ndarray:
    """A map as stored, [..., channels], to what the network has as results for it, float32 [..., trained channels]."""
    channels = list(each.trained)
    low, high = (np.float64(ends)[channels] for ends in (each.low, each.high))
    values = values[..., channels] if len(channels) < each.channels else values
    if each.kind == "hdr":
        values = np.log2(np.maximum(values, 0) + 2**low)
    elif (low == 0).all() and (high == 1).all():
        return values.astype(np.float32, copy=False)
    return np.clip((values - low) / (high - low), 0, 1).astype(np.float32)


def to_stored(results: np.ndarray, each: Map) -> np.ndarray:
    """The inverse, float32 [..., channels], with results clipped to [0, 1] and constant channels filled in."""
    channels = list(each.trained)
    low, high = (np.float64(ends)[channels] for ends in (each.low, each.high))
    values = np.clip(results, 0, 1)
    if each.kind == "hdr":
        values = np.maximum(2 ** (low + values * (high - low)) - 2**low, 0)
    elif (low != 0).any() or (high != 1).any():
        values = low + values * (high - low)
    stored = np.empty((*results.shape[:-1], each.channels), np.float32)
    stored[...] = each.low
    stored[..., channels] = values
    return stored


def to_maps(results: np.ndarray, maps: Sequence[Map]) -> dict[str, np.ndarray]:
    """Results of the network, [..., channels of all maps], to every map as stored, float32 [..., its channels]."""
    places = np.cumsum([0, *(len(each.trained) for each in maps)])
    return {
        each.name: to_stored(results[..., a:b], each) for each, a, b in zip(maps, places[:-1], places[1:], strict=True)
    }


def _channels(picture: Picture) -> range:
    return range(picture.levels[0].shape[-1])


def _extent(levels: Sequence[np.ndarray]) -> tuple[float, float]:
    return min(float(level.min()) for level in levels), max(float(level.max()) for level in levels)


def _is_binary(values: np.ndarray) -> bool:
    return float(((values <= _GREY) | (values >= 1 - _GREY)).mean()) >= _BINARY


def _logarithms(values: np.ndarray, highest: float) -> tuple[float, float]:
    """The low and high of an hdr map, numbers of float32."""
    lit = values[values > 0]
    dark = max(_DARK * float(np.median(lit)), highest / 2**_BITS_OF_HDR) if lit.size else 1.0
    low = float(np.float32(np.log2(dark)))
    return low, float(np.nextafter(np.float32(np.log2(highest + 2**low)), np.float32(np.inf)))
