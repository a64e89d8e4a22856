"""A flat patch of a material under a point light: what the pictures show."""

from functools import cache

import numpy as np
import warp as wp

from warp_neural.kernels.shading.tonemap import display
from warp_neural.materials.layered import LayeredSet
from warp_neural.materials.neural import NeuralMaterial

SIDE, SAMPLES = 256, 4  # pixels, and the root of the samples in one
LIGHT = wp.constant(wp.vec3(0.35, 0.75, 0.5))  # above the unit square
EYE = wp.constant(wp.vec3(0.5, -0.6, 1.3))
POWER = wp.constant(4.0)


@cache
def make_patch_kernel(params_type, evaluate: wp.Function) -> wp.Kernel:
    """Of any set of materials: radiance, displayed, the mean of each pixel's samples."""

    @wp.kernel(module="unique", enable_backward=False)
    def patch_kernel(params: params_type, lod: float, picture: wp.array2d[wp.vec3]):
        i, j = wp.tid()
        total = wp.vec3()
        for k in range(SAMPLES * SAMPLES):
            x = float(j) + (float(k % SAMPLES) + 0.5) / float(SAMPLES)
            y = float(i) + (float(k / SAMPLES) + 0.5) / float(SAMPLES)
            at = wp.vec3(x / float(picture.shape[1]), 1.0 - y / float(picture.shape[0]), 0.0)
            to_light, view = LIGHT - at, wp.normalize(EYE - at)
            falloff = POWER / wp.dot(to_light, to_light)
            total += evaluate(params, 0, wp.vec2(at[0], at[1]), lod, wp.normalize(to_light), view) * falloff
        picture[i, j] = display(total / float(SAMPLES * SAMPLES))

    return patch_kernel


def patch(material: NeuralMaterial | LayeredSet, side: int | None = None) -> np.ndarray:
    """Displayed, [SIDE, SIDE, 3]. side: of the latents that the reference is seen with."""
    picture = wp.empty((SIDE, SIDE), dtype=wp.vec3, device=material.device)
    lod = 0.0
    if side is not None:
        largest = max((max(material.materials[0].value(name).shape[:2]) for name in material.spec.maps), default=1)
        lod = float(np.log2(max(largest / side, 1)))
    kernel = make_patch_kernel(material.Params, material.evaluate)
    wp.launch(kernel, picture.shape, [material.params, lod], [picture], device=material.device)
    return picture.numpy()
