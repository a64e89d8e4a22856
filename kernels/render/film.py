"""From sums of samples to what a screen shows."""

import warp as wp

from warp_neural.kernels.shading.tonemap import display


@wp.kernel(enable_backward=False)
def display_kernel(radiance: wp.array2d[wp.vec3], shown: wp.array2d[wp.vec3]):
    i, j = wp.tid()
    shown[i, j] = display(radiance[i, j])
