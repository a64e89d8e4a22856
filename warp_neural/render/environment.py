"""`Environment`: light from all directions, a picture or made by code."""

from pathlib import Path

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.imaging.density import Density
from warp_neural.imaging.image import load_image
from warp_neural.kernels.errors import is_finite, require
from warp_neural.kernels.render.environment import EnvironmentData

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709
STUDIO = (  # softboxes: towards where (x, y, z), half of width and height at distance 1, radiance
    ((-0.75, 0.62, 0.55), (0.42, 0.32), (8.0, 7.6, 7.1)),
    ((0.95, 0.25, 0.1), (0.2, 0.55), (2.6, 3.0, 3.4)),
)
EDGE = 0.04  # of softboxes, where they fade


class Environment:
    """Linear radiance `image` [height, width, 3], equirectangular, finite and not negative.

    Its middle lies towards -z, its right half towards +x, its top up (+y). rotation: degrees by which it is turned to
    the right. scale: a factor of the radiance. Directions are drawn in proportion to luminance.
    """

    def __init__(self, image: np.ndarray, *, rotation: float = 0.0, scale: float = 1.0):
        try:
            self.image = np.array(image, np.float32)
        except (TypeError, ValueError):
            raise InputError("environment: no array of numbers; give [height, width, 3]") from None
        if self.image.ndim != 3 or self.image.shape[2] != 3 or 0 in self.image.shape:
            raise InputError(f"environment: shape {self.image.shape}; give [height, width, 3]")
        require(is_finite(rotation), "rotation", rotation, "degrees")
        require(is_finite(scale) and scale >= 0, "scale", scale, "a number of at least 0")
        if not np.isfinite(self.image).all() or self.image.min() < 0:
            raise InputError("environment: negative or not finite radiance; np.clip(image, 0, None) makes it light")
        with np.errstate(over="ignore"):
            self.image *= scale
        require(float(self.image.max()) < 1e20, "scale", scale, "one that leaves the radiance below 1e20")
        self.rotation = float(rotation)
        self._data: dict[str, EnvironmentData] = {}

    @classmethod
    def load(cls, path: Path | str, *, rotation: float = 0.0, scale: float = 1.0) -> "Environment":
        """From EXR or Radiance HDR (or any picture), as `load_image` reads it."""
        image = load_image(path)
        image = np.broadcast_to(image[..., :1] if image.shape[2] < 3 else image[..., :3], (*image.shape[:2], 3))
        try:
            return cls(image, rotation=rotation, scale=scale)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    @classmethod
    def constant(cls, color: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> "Environment":
        """The same radiance from everywhere."""
        return cls(np.broadcast_to(np.asarray(color, np.float32), (16, 32, 3)))

    @classmethod
    def studio(cls, *, height: int = 256, rotation: float = 0.0, scale: float = 1.0) -> "Environment":
        """Two softboxes, warm on the left and cool on the right, in a grey room that is lighter above."""
        theta = np.pi * (np.arange(height)[:, None] + 0.5) / height
        phi = np.pi * ((np.arange(2 * height) + 0.5) / height - 1)
        x, y, z = np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)
        direction = np.stack(np.broadcast_arrays(x, y, z), axis=-1)
        up = 0.5 + 0.5 * direction[..., 1:2]
        image = (0.06 + 0.3 * up**2) * np.array([0.96, 1.0, 1.06])
        for towards, size, radiance in STUDIO:
            image += softbox(direction, np.array(towards), np.array(size))[..., None] * radiance
        return cls(image, rotation=rotation, scale=scale)

    def __repr__(self) -> str:
        return f"Environment({self.image.shape[1]} x {self.image.shape[0]}, turned by {self.rotation:g} degrees)"

    def data(self, device: wp.DeviceLike = None) -> EnvironmentData:
        """For kernels; made once for each device."""
        device = find_device(device)
        if device.alias not in self._data:
            weights = self.image.astype(np.float64) @ LUMINANCE
            if not weights.any():
                weights = np.ones_like(weights)  # a black one is drawn from too
            height = len(weights)
            weights *= np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None]
            data = EnvironmentData()
            data.radiance = wp.array(self.image, dtype=wp.vec3, device=device)
            data.weights = wp.array(weights / weights.mean(), dtype=float, device=device)
            data.density = Density(weights, device=device).data
            data.turn = self.rotation / 360.0 % 1.0
            self._data[device.alias] = data
        return self._data[device.alias]


def softbox(direction: np.ndarray, towards: np.ndarray, size: np.ndarray) -> np.ndarray:
    """In [0, 1]: where a rectangle at distance 1 is seen, with a soft edge. [...]"""
    forward = towards / np.linalg.norm(towards)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    distance = direction @ forward
    ahead = np.maximum(distance, 1e-3)
    x, y = (np.abs(direction @ axis) / ahead for axis in (right, np.cross(right, forward)))
    inside = np.minimum(size[0] - x, size[1] - y) / EDGE
    t = np.clip(inside, 0, 1) * (distance > 0)
    return t * t * (3 - 2 * t)
