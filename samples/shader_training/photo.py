"""The image that steps 2 and 3 learn."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural.cli import Between, TrainingConfig
from warp_neural.imaging.image import displayed_psnr, linear_to_srgb, load_image, srgb_to_linear


@dataclass(frozen=True, kw_only=True)
class PhotoConfig(TrainingConfig):
    out: Path = Path("out/shader_training")
    """folder for pictures and files"""
    image: Path | None = None
    """PNG, JPEG, TIFF, HDR or EXR to learn, without alpha; none: a cat that scikit-image carries"""
    size: Annotated[int, Between(8, 4096)] = 256
    """side in pixels of the square that is cut out of its middle, smaller if the image is"""


def load_photo(config: PhotoConfig) -> np.ndarray:
    """Linear RGB `[size, size, 3]` in [0, 1], float32."""
    if config.image is None:
        from skimage import data

        image = srgb_to_linear(data.chelsea() / 255.0)
    else:
        image = np.clip(load_image(config.image), 0, 1)
    image = image[..., :3] if image.shape[-1] >= 3 else image.repeat(3, axis=-1)
    size = min(config.size, *image.shape[:2])
    top, left = (image.shape[0] - size) // 2, (image.shape[1] - size) // 2
    return image[top : top + size, left : left + size].astype(np.float32)


def psnr(truth: np.ndarray, picture: np.ndarray) -> float:
    """In dB, of sRGB values of linear pictures."""
    return displayed_psnr(linear_to_srgb(truth), linear_to_srgb(picture))


@wp.func
def mirrored(texels: wp.array2d[wp.vec3], i: int, j: int) -> wp.vec3:
    """The texture goes on mirrored at its edges."""
    height, width = texels.shape[0], texels.shape[1]
    y = ((i % (2 * height)) + 2 * height) % (2 * height)
    x = ((j % (2 * width)) + 2 * width) % (2 * width)
    return texels[wp.min(y, 2 * height - 1 - y), wp.min(x, 2 * width - 1 - x)]


@wp.func
def bilinear(texels: wp.array2d[wp.vec3], uv: wp.vec2) -> wp.vec3:
    """u along the width, v down the height, [0, 1] from edge to edge."""
    x, y = uv[0] * float(texels.shape[1]) - 0.5, uv[1] * float(texels.shape[0]) - 0.5
    j, i = int(wp.floor(x)), int(wp.floor(y))
    s, t = x - float(j), y - float(i)
    top = wp.lerp(mirrored(texels, i, j), mirrored(texels, i, j + 1), s)
    return wp.lerp(top, wp.lerp(mirrored(texels, i + 1, j), mirrored(texels, i + 1, j + 1), s), t)


@cache
def make_picture_kernel(func: wp.Function) -> wp.Kernel:
    """dim (height, width): what `func` of a network of 2 inputs and 3 outputs makes of each pixel's centre."""
    params_type = func.input_types["params"]  # of its shape alone

    @wp.kernel(module="unique", enable_backward=False)
    def picture_kernel(params: params_type, image: wp.array2d[wp.vec3]):
        i, j = wp.tid()
        uv = wp.vec2((float(j) + 0.5) / float(image.shape[1]), (float(i) + 0.5) / float(image.shape[0]))
        y = func(params, uv)
        image[i, j] = wp.vec3(y[0], y[1], y[2])

    return picture_kernel


def picture(net: wn.MLP, size: int) -> np.ndarray:
    """What a network holds of an image, linear `[size, size, 3]`."""
    image = wp.empty((size, size), dtype=wp.vec3, device=net.device)
    kernel = make_picture_kernel(net.func)
    wp.launch(kernel, dim=image.shape, inputs=[net.params, image], device=net.device, record_tape=False)
    return image.numpy()
