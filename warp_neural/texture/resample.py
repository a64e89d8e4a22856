"""Other sizes: the area filter for fewer texels, Catmull-Rom's cubic for more; and mip chains."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array, csr_array

from warp_neural.imaging.image import linear_to_srgb, srgb_to_linear
from warp_neural.texture.kinds import to_maps, to_network
from warp_neural.texture.state import Kind, Map

_HIDDEN = 1 / 1024  # weight of colours under an alpha of 0, so that they stay what they are


def resample(values: np.ndarray, kind: Kind, size: tuple[int, int]) -> np.ndarray:
    """A map as stored, [height, width, channels], at another (height, width); filtered as light, see `to_light`."""
    light = _scale(to_light(values, kind), size)
    stored = to_stored_light(light, kind)
    return np.clip(stored, values.min((0, 1)), values.max((0, 1))) if kind != "normal" else np.clip(stored, 0, 1)


def mip_levels(values: np.ndarray, maps: Sequence[Map], count: int) -> list[np.ndarray]:
    """`count` levels below `values`, what the network has as results, [height, width, channels]: each half as large,
    rounded down, every texel the mean of its share of the level above."""
    stored = to_maps(values, maps)
    lights = {each.name: to_light(stored[each.name], each.kind) for each in maps}
    levels = []
    for _ in range(count):
        height, width = next(iter(lights.values())).shape[:2]
        size = max(height // 2, 1), max(width // 2, 1)
        lights = {name: _scale(light, size) for name, light in lights.items()}
        results = [to_network(to_stored_light(lights[each.name], each.kind), each) for each in maps]
        levels.append(np.clip(np.concatenate(results, axis=-1), 0, 1))
    return levels


def to_light(values: np.ndarray, kind: Kind) -> np.ndarray:
    """As stored to what may be averaged: linear light, times alpha where there is one, vectors, or the numbers."""
    if kind == "normal":
        return np.concatenate([2 * values[..., :3] - 1, values[..., 3:]], axis=-1)
    if kind not in ("srgb", "hdr"):
        return values
    colours, alpha = _split(values)
    light = srgb_to_linear(colours) if kind == "srgb" else colours
    return np.concatenate([light * (alpha + _HIDDEN), alpha], axis=-1) if alpha.size else light


def to_stored_light(light: np.ndarray, kind: Kind) -> np.ndarray:
    """The inverse, with vectors of unit length."""
    if kind == "normal":
        vectors = light[..., :3]
        length = np.linalg.norm(vectors, axis=-1, keepdims=True)
        vectors = np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), np.float32([0, 0, 1]))
        return np.concatenate([0.5 * vectors + 0.5, light[..., 3:]], axis=-1, dtype=np.float32)
    if kind not in ("srgb", "hdr"):
        return light
    colours, alpha = _split(light)
    colours = colours / (np.maximum(alpha, 0) + _HIDDEN) if alpha.size else colours
    colours = linear_to_srgb(colours) if kind == "srgb" else colours
    return np.concatenate([colours, alpha], axis=-1, dtype=np.float32)


def _split(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours and alpha: channel 2 of 2, 4 of 4."""
    colours = values.shape[-1] - (values.shape[-1] in (2, 4))
    return values[..., :colours], values[..., colours:]


def _scale(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    height, width, channels = values.shape
    rows, columns = _weights(height, size[0]), _weights(width, size[1])
    values = (rows @ values.reshape(height, -1)).reshape(size[0], width, channels)
    values = (columns @ values.swapaxes(0, 1).reshape(width, -1)).reshape(size[1], size[0], channels)
    return np.ascontiguousarray(values.swapaxes(0, 1))


def _weights(old: int, new: int) -> csr_array:
    """[new, old] of float32, each row adding up to 1."""
    return (_area if new <= old else _cubic)(old, new)


def _area(old: int, new: int) -> csr_array:
    """New texel i has the mean of the old ones from i old / new to (i + 1) old / new, by their shares."""
    texels = np.arange(old, dtype=np.int64)
    first, last = texels * new // old, ((texels + 1) * new - 1) // old  # the one or two new ones it lies in
    share = np.minimum((first + 1) * old, (texels + 1) * new) - texels * new  # of the first, in 1 / new texels
    shares = np.concatenate([share, new - share]) / np.float32(old)
    return coo_array((shares, (np.concatenate([first, last]), np.tile(texels, 2))), shape=(new, old)).tocsr()


def _cubic(old: int, new: int) -> csr_array:
    """Catmull and Rom 1974: four old texels, those of the edges repeated beyond."""
    places = (np.arange(new) + 0.5) * (old / new) - 0.5
    left = np.floor(places).astype(np.int64)
    t = places - left
    taps = [
        -0.5 * t**3 + t**2 - 0.5 * t,
        1.5 * t**3 - 2.5 * t**2 + 1,
        -1.5 * t**3 + 2 * t**2 + 0.5 * t,
        0.5 * t**3 - 0.5 * t**2,
    ]
    texels = np.clip(np.concatenate([left - 1, left, left + 1, left + 2]), 0, old - 1)
    weights = np.concatenate(taps).astype(np.float32)
    return coo_array((weights, (np.tile(np.arange(new), 4), texels)), shape=(new, old)).tocsr()
