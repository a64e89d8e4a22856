"""The picture of 100 MB or more that the neural texture learns."""

from pathlib import Path

import numpy as np
from skimage import data

from warp_neural.imaging.image import linear_to_srgb, load_image


def load_picture(path: Path | None, side: int, seed: int) -> np.ndarray:
    """8-bit sRGB `[height, width, 3]`: the file, or `tiles` of `side` pixels. Raises `InputError` for bad files."""
    if path is None:
        return tiles(side, seed)
    image = load_image(path)
    image = image.repeat(3, axis=-1) if image.shape[-1] == 1 else image[..., :3]
    codes = np.empty(image.shape, dtype=np.uint8)
    for row in range(len(image)):  # a whole picture in float64 would not fit
        codes[row] = np.rint(255 * linear_to_srgb(np.clip(image[row], 0, 1)))
    return codes


def tiles(side: int, seed: int, size: int = 512) -> np.ndarray:
    """Photographs that scikit-image carries, `size` pixels each, turned, mirrored and tinted at random."""
    photographs = [square(photo(), size) for photo in (data.astronaut, data.chelsea, data.coffee, data.rocket)]
    rng, count = np.random.default_rng(seed), -(-side // size)
    picture = np.empty((count * size, count * size, 3), dtype=np.uint8)
    for k in range(count * count):
        tile = np.rot90(photographs[k % len(photographs)], rng.integers(4))[:, :: rng.choice([-1, 1])]
        row, column = k // count * size, k % count * size
        picture[row : row + size, column : column + size] = tile * rng.uniform(0.6, 1, 3)
    return picture[:side, :side]


def square(photo: np.ndarray, size: int) -> np.ndarray:
    """The middle of a photograph, mirrored outwards where it is too small."""
    padding = [(max(size - n + 1, 0) // 2,) * 2 for n in photo.shape[:2]]
    photo = np.pad(photo, [*padding, (0, 0)], mode="symmetric")
    top, left = ((n - size) // 2 for n in photo.shape[:2])
    return photo[top : top + size, left : left + size]
