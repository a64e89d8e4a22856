"""The weight of each tap of a grid, from its trained kernels or of bilinear interpolation."""

from functools import cache

import warp as wp

from warp_neural.kernels.texture.layout import BILINEAR, Layout
from warp_neural.kernels.texture.spec import TextureSpec


@cache
def make_taps(spec: TextureSpec, g: int) -> wp.Function:
    """`(kernels, channel, py, px) -> vec4`: weights of the latents of the own cell, right, below, right and below, for
    the texel of phase (py, px)."""
    grid, places = spec.grids[g], Layout(spec).places
    scale, channels = wp.constant(grid.scale), wp.constant(grid.channels)

    if grid.kernel == "learned":
        start = wp.constant(places[f"kernel_{g}"].start)

        @wp.func
        def taps(kernels: wp.array[float], channel: int, py: int, px: int) -> wp.vec4:
            i = start + (py * scale + px) * 4 * channels + channel
            return wp.vec4(kernels[i], kernels[i + channels], kernels[i + 2 * channels], kernels[i + 3 * channels])

    elif grid.kernel == "separable":
        start_y, start_x = (wp.constant(places[f"kernel_{g}_{axis}"].start) for axis in "yx")

        @wp.func
        def taps(kernels: wp.array[float], channel: int, py: int, px: int) -> wp.vec4:
            i = start_y + py * 2 * channels + channel
            j = start_x + px * 2 * channels + channel
            y0, y1, x0, x1 = kernels[i], kernels[i + channels], kernels[j], kernels[j + channels]
            return wp.vec4(y0 * x0, y0 * x1, y1 * x0, y1 * x1)

    else:
        size = wp.constant(1.0 / grid.scale)

        @wp.func
        def taps(kernels: wp.array[float], channel: int, py: int, px: int) -> wp.vec4:
            y = (float(py) + 0.5) * size
            x = (float(px) + 0.5) * size
            return BILINEAR * wp.vec4((1.0 - y) * (1.0 - x), (1.0 - y) * x, y * (1.0 - x), y * x)

    return taps
