"""`Camera`: from where a picture is taken."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.errors import is_finite, require
from warp_neural.kernels.render.camera import CameraData

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Camera:
    """A pinhole at `eye` that looks at `target`. fov: degrees from the picture's top to its bottom."""

    eye: Vector = (0.0, 2.4, 6.2)
    target: Vector = (0.0, 1.12, 0.0)
    up: Vector = (0.0, 1.0, 0.0)
    fov: float = 28.0

    def data(self, width: int, height: int) -> CameraData:
        """For kernels; of a picture with square pixels."""
        require(is_finite(self.fov) and 0 < self.fov < 180, "fov", self.fov, "degrees, above 0 and below 180")
        eye, target, up = (vector(name, getattr(self, name)) for name in ("eye", "target", "up"))
        forward = target - eye
        right = np.cross(forward, up)
        if np.linalg.norm(right) < 1e-9 * np.linalg.norm(forward) * np.linalg.norm(up) or not forward.any():
            raise InputError(f"camera: at {self.eye}, towards {self.target}: looks nowhere, or along up={self.up}")
        forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
        half = np.tan(np.radians(self.fov) / 2)
        data = CameraData()
        data.eye, data.forward = wp.vec3(*eye), wp.vec3(*forward)
        data.right = wp.vec3(*(half * width / height * right))
        data.up = wp.vec3(*(half * np.cross(right, forward)))
        return data


def vector(name: str, values: Vector) -> np.ndarray:
    """Three finite numbers, or an `InputError` that says so."""
    try:
        vector = np.array(values, np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    require(vector.shape == (3,) and bool(np.isfinite(vector).all()), name, values, "three finite numbers")
    return vector
