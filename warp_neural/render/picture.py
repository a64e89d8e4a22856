"""`Picture`: what a renderer has seen."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.imaging.image import linear_to_srgb, save_image
from warp_neural.kernels.errors import is_finite, require
from warp_neural.kernels.render.film import display_kernel

Curve = Literal["film", "srgb"]


@dataclass(frozen=True, eq=False)
class Picture:
    """Means over `samples` of each pixel, float32.

    radiance [height, width, 3]: linear. albedo, normal [height, width, 3]: of the first surface, zero where there is
    none, normals in space and towards the camera. alpha [height, width]: the share of samples that met a surface.
    dropped: samples that were not finite and count as black, of all pixels. seconds: that it took.
    """

    radiance: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    alpha: np.ndarray
    samples: int
    dropped: int
    seconds: float

    def shown(self, *, curve: Curve = "film", exposure: float = 0.0) -> np.ndarray:
        """Values of a screen in [0, 1], [height, width, 3]. exposure: in stops.

        curve: "film", the course's (`kernels.shading.tonemap`: a fit of ACES, then gamma 1/2.2), which keeps bright
        light apart, or "srgb", which cuts it off at 1 (IEC 61966-2-1).
        """
        return _shown(self.radiance, curve, exposure)

    def save(self, path: Path | str, *, curve: Curve = "film", exposure: float = 0.0, alpha: bool = False) -> None:
        """EXR and Radiance HDR: `radiance`, linear; PNG, JPEG and TIFF: `shown` in 8 bits.

        alpha: as a fourth channel, of what was rendered before a `background` of (0, 0, 0). Whole or not at all; raises
        `InputError` where it cannot be written.
        """
        light = self.radiance
        if alpha:  # files hold the surface's own light, not mixed with the background's
            light = light / np.where(self.alpha > 0, self.alpha, 1)[..., None]
        linear = Path(path).suffix.lower() in (".exr", ".hdr")
        image = light if linear else _shown(light, curve, exposure)
        save_image(path, np.dstack([image, self.alpha]) if alpha else image, color_space="linear")

    def save_features(self, folder: Path | str) -> None:
        """`albedo.exr` and `normal.exr`, as denoisers take them."""
        for name in ("albedo", "normal"):
            save_image(Path(folder) / f"{name}.exr", getattr(self, name))


def _shown(light: np.ndarray, curve: Curve, exposure: float) -> np.ndarray:
    require(is_finite(exposure) and abs(exposure) <= 60, "exposure", exposure, "a number of stops")
    if curve not in ("film", "srgb"):
        raise InputError(f"curve={curve!r}; choose 'film' or 'srgb'")
    light = np.clip(light * 2.0**exposure, 0, 1e6).astype(np.float32)  # the film curve squares it
    if curve == "srgb":
        return linear_to_srgb(np.minimum(light, 1))
    radiance = wp.array(light, dtype=wp.vec3, device="cpu")
    result = wp.empty_like(radiance)
    wp.launch(display_kernel, radiance.shape, [radiance], [result], device="cpu", record_tape=False)
    return result.numpy()
