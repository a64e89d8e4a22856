"""A pinhole camera."""

import warp as wp


@wp.struct
class CameraData:
    """right, up: unit vectors times half of the picture's extent at distance 1 along the unit vector forward."""

    eye: wp.vec3
    right: wp.vec3
    up: wp.vec3
    forward: wp.vec3


@wp.func
def ray_of(camera: CameraData, x: float, y: float, width: int, height: int) -> wp.vec3:
    """Unit vector through the point (x right, y down, in pixels) of a picture."""
    across, down = 2.0 * x / float(width) - 1.0, 2.0 * y / float(height) - 1.0
    return wp.normalize(camera.forward + camera.right * across - camera.up * down)


@wp.func
def pixel_angle(camera: CameraData, height: int) -> float:
    """In radians, of a pixel in the middle of the picture (Akenine-Möller et al. 2019, section 20.3.4)."""
    return wp.atan(2.0 * wp.length(camera.up) / float(height))
