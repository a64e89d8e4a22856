"""What the pictures of all sections share: one picture on an axis, figures and pictures into files."""

from pathlib import Path

import numpy as np

from warp_neural.imaging.image import save_image
from warp_neural.io.files import atomic_path


def show(axis, picture: np.ndarray, title: str):
    """Displayed values `[height, width, 3]`, clipped to [0, 1], or `[height, width]` through the colour map."""
    axis.set_title(title, fontsize=10)
    axis.axis("off")
    return axis.imshow(np.clip(picture, 0, 1) if picture.ndim == 3 else picture, interpolation="nearest")


def save_figure(path: Path, figure) -> None:
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110, bbox_inches="tight")


def save_picture(path: Path, displayed: np.ndarray) -> None:
    """Displayed values `[height, width, 3]` as they are."""
    save_image(path, np.clip(displayed, 0, 1), color_space="linear")
