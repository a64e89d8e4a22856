"""The shader, its random directions and its texture reads, for samples and users' own kernels; and the box filter."""

import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.shading.brdf import brdf, ggx, ggx_alpha, schlick
from warp_neural.kernels.shading.sampling import (
    direction_around,
    lobe_density,
    lobe_light,
    lobe_view,
    uniform_hemisphere,
)
from warp_neural.kernels.shading.texture import downsample_kernel, read_float, read_vec3
from warp_neural.kernels.shading.tonemap import aces, display, display_smooth

__all__ = [
    "aces",
    "brdf",
    "direction_around",
    "display",
    "display_smooth",
    "downsample",
    "ggx",
    "ggx_alpha",
    "lobe_density",
    "lobe_light",
    "lobe_view",
    "read_float",
    "read_vec3",
    "schlick",
    "uniform_hemisphere",
]


def downsample(image: wp.array) -> wp.array:
    """The next mip level by a 2 x 2 box: `[height, width]` of float or vec3 to half of each.

    Raises `InputError` if a side is odd.
    """
    height, width = image.shape
    if height % 2 or width % 2:
        raise InputError(f"an image of {width} x {height} cannot be halved; crop it to even sides")
    coarse = wp.empty((height // 2, width // 2), dtype=image.dtype, device=image.device)
    wp.launch(downsample_kernel, dim=coarse.shape, inputs=[image], outputs=[coarse], device=image.device)
    return coarse
