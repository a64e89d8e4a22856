"""What the steps share and do not teach: the target picture, its quality measure, saving."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from skimage import data

from warp_neural.cli import Between, Count, Positive, TrainingConfig
from warp_neural.imaging.image import displayed_psnr, linear_to_srgb, load_image, save_image, srgb_to_linear


@dataclass(frozen=True, kw_only=True)
class Config(TrainingConfig):
    """The options of every step."""

    out: Path = Path("out/network")
    """folder for pictures and files"""
    image: Path | None = None
    """picture to learn; none: 256 x 256 of NASA's photograph of Eileen Collins, which scikit-image carries"""
    steps: Count = 2000
    """gradient steps"""
    rate: Positive = 0.01
    """Adam's learning rate at the start; it falls to a hundredth on a cosine"""
    batch: Annotated[int | None, Between(4096, 2**24, multiple=4096)] = None
    """samples a step, whole 64 x 64 grids; none: one grid (4096) on the CPU, sixteen (65536) on CUDA"""


def load_target(config: Config) -> np.ndarray:
    """Linear float32 `[height, width, 3]`; grey becomes RGB, alpha is left out. Raises `InputError` for bad files."""
    if config.image is None:
        return srgb_to_linear(data.astronaut()[:256, 96:352] / 255).astype(np.float32)
    image = load_image(config.image)
    return np.repeat(image, 3, axis=-1) if image.shape[-1] == 1 else np.ascontiguousarray(image[..., :3])


def psnr(picture: np.ndarray, target: np.ndarray) -> float:
    """Of two linear pictures as 8-bit sRGB, in dB: all pixels and channels."""
    return displayed_psnr(srgb_codes(target) / 255, srgb_codes(picture) / 255)


def srgb_codes(linear: np.ndarray) -> np.ndarray:
    return np.rint(255 * linear_to_srgb(np.clip(linear, 0, 1)))


def save_beside(path: Path, target: np.ndarray, picture: np.ndarray) -> None:
    """The target on the left, the linear `picture` on the right."""
    save_image(path, np.clip(np.concatenate([target, picture], axis=1), 0, 1), color_space="srgb")
