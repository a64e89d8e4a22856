"""The material that needs no file: paving made from two CC0 photographs that scikit-image carries."""

import numpy as np
from scipy.ndimage import gaussian_filter
from skimage import data

from warp_neural.errors import InputError
from warp_neural.materials.material import Material

_PHOTO_SIZE = 512
_RELIEF = 6.0  # texels of height that a height of 1 stands for


def default_material(size: int = _PHOTO_SIZE) -> Material:
    """Glazed, pitted bricks between rough, sandy joints, `size` x `size` texels; 512 is the photographs' own size.

    Smaller sizes are the middle of it, larger ones go on mirrored; not periodic. Glossy faces (roughness about 0.35)
    stand beside rough joints and pits (about 0.85), and normals vary from texel to texel on both, so that averaging the
    maps is plainly wrong. Deterministic. Raises `InputError` for a size below 4 or above 4096.
    """
    if not 4 <= size <= 4096:
        raise InputError(f"default material of size {size}; choose a size from 4 to 4096")
    brick, gravel = (_photo(picture(), max(size, _PHOTO_SIZE)) for picture in (data.brick, data.gravel))
    joint = _smoothstep(0.42, 0.54, gaussian_filter(brick, 0.7))  # 1 in the mortar, the bright part of the photograph
    grain = gravel - gaussian_filter(gravel, 6.0)  # about -0.35 to 0.25: edges of stones, without the light on them
    grit = _photo(data.gravel()[::2, ::2], gravel.shape[0])  # the same stones at half the size
    grit -= gaussian_filter(grit, 2.5)
    pits = _smoothstep(0.08, 0.25, -grain) * (1 - joint)
    height = 0.15 + 0.7 * (1 - gaussian_filter(joint, 1.5)) + (0.25 + 0.1 * joint) * grain + 0.25 * grit
    maps = {
        "albedo": _albedo(brick, gravel, joint, pits),
        "normal": _normal(_RELIEF * height),
        "roughness": _roughness(grain + grit, joint, pits),
        "metalness": np.zeros_like(height),
        "ao": np.clip(1 - 1.5 * np.maximum(gaussian_filter(height, 4.0) - height, 0), 0, 1),
        "height": np.clip(height, 0, 1),
        "opacity": np.ones_like(height),
    }
    return Material("default", **{name: value.astype(np.float32) for name, value in maps.items()}).crop(size)


def _photo(picture: np.ndarray, size: int) -> np.ndarray:
    """uint8 square of any size to `[size, size]` in [0, 1], mirrored outwards from the middle."""
    before = (size - len(picture)) // 2
    after = size - len(picture) - before
    return np.pad(picture.astype(np.float32) / 255, (before, after), mode="symmetric")


def _smoothstep(low: float, high: float, x: np.ndarray) -> np.ndarray:
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def _albedo(brick: np.ndarray, gravel: np.ndarray, joint: np.ndarray, pits: np.ndarray) -> np.ndarray:
    """Linear `[h, w, 3]`: red clay whose tone follows the photograph and drifts slowly, sand-grey mortar."""
    tone = 1 + 4 * (gaussian_filter(brick, 1.0) - 0.39) * (1 - joint) + 1.2 * (gaussian_filter(gravel, 12.0) - 0.5)
    clay = np.array([0.30, 0.085, 0.045]) * (tone * (1 - 0.45 * pits))[..., None]
    mortar = np.array([0.36, 0.33, 0.28]) * (0.45 + 1.1 * gravel)[..., None]
    return np.clip(clay + (mortar - clay) * joint[..., None], 0.01, 0.9)


def _roughness(grain: np.ndarray, joint: np.ndarray, pits: np.ndarray) -> np.ndarray:
    """`[h, w]` in [0.28, 0.92]: glaze, worn where the grain stands out; mortar and pits rough."""
    glaze = 0.34 + 0.3 * np.clip(grain, -0.1, 0.3) + 0.45 * pits
    return np.clip(glaze + (0.85 + 0.2 * grain - glaze) * joint, 0.28, 0.92)


def _normal(height: np.ndarray) -> np.ndarray:
    """Height in texels `[h, w]` to unit normals `[h, w, 3]`; rows go down the picture while y goes up it."""
    down, right = np.gradient(height)
    normal = np.stack([-right, down, np.ones_like(height)], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)
