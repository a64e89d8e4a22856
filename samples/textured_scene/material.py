"""A material that repeats without a seam, made by code: glazed tiles in rough mortar."""

import numpy as np

from warp_neural.materials.material import DEFAULTS, Material

TILES = 4  # a side
JOINT = 0.06  # width, in tiles
RELIEF = 0.02  # height of a tile, in sides of the picture
COLOURS = (0.36, 0.09, 0.05), (0.42, 0.36, 0.25), (0.06, 0.16, 0.22), (0.10, 0.20, 0.09)  # linear


def tiled_material(size: int, seed: int = 0) -> Material:
    """`size` x `size` texels of albedo, normal and roughness; neighbours left and right, above and below fit."""
    random = np.random.default_rng(seed)
    fine, coarse = periodic_noise(size, 0.7, random), periodic_noise(size, 1.6, random)
    place = (np.arange(size) + 0.5) / size * TILES
    from_joint = np.minimum(place % 1, 1 - place % 1)
    y, x = np.meshgrid(from_joint, from_joint, indexing="ij")
    tile = np.clip((np.minimum(x, y) - JOINT / 2 + 0.01 * coarse) / JOINT, 0, 1)  # 0 in the joints
    tile = tile * tile * (3 - 2 * tile)
    row, column = np.meshgrid(place.astype(int), place.astype(int), indexing="ij")
    colours = np.array(COLOURS)[random.integers(0, len(COLOURS), (TILES, TILES))][row, column]
    colours = colours * (1 + 0.25 * coarse + 0.1 * fine)[..., None]
    mortar = np.array([0.34, 0.32, 0.29]) * (1 + 0.3 * fine)[..., None]
    height = RELIEF * size * (tile + 0.06 * fine * (1.3 - tile) + 0.1 * coarse * tile) / TILES
    maps = DEFAULTS | {
        "albedo": np.clip(mortar + (colours - mortar) * tile[..., None], 0.01, 0.9),
        "normal": normals(height),
        "roughness": np.clip(0.85 + (0.3 + 0.08 * coarse - 0.85) * tile + 0.05 * fine, 0.15, 1),
    }
    for name in ("metalness", "ao", "height", "opacity"):
        maps[name] = np.full((size, size), maps[name])
    return Material("tiles", **{name: value.astype(np.float32) for name, value in maps.items()})


def periodic_noise(size: int, slope: float, random: np.random.Generator) -> np.ndarray:
    """Mean 0, variance 1; amplitudes fall as frequency^-slope. [size, size]"""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size), indexing="ij")) * size
    spectrum = np.fft.fft2(random.standard_normal((size, size))) / np.maximum(frequency, 1) ** slope
    spectrum[0, 0] = 0
    noise = np.fft.ifft2(spectrum).real
    return noise / noise.std()


def normals(height: np.ndarray) -> np.ndarray:
    """Of a height in texels that wraps; y up the picture. [size, size, 3]"""
    down, right = ((np.roll(height, -1, axis) - np.roll(height, 1, axis)) / 2 for axis in (0, 1))
    normal = np.stack([-right, down, np.ones_like(height)], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)
