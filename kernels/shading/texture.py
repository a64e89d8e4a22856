"""Texel reads that write their gradient to a buffer, and the 2 x 2 box filter.

The course's `get_albedo`: forward it reads a texel, backward it stores what the shader sends back. It stores and does
not add, because each thread owns its texel; reads that share texels must use `wp.atomic_add` instead.
"""

from typing import Any

import warp as wp


@wp.func
def read_vec3(texels: wp.array2d[wp.vec3], gradients: wp.array2d[wp.vec3], i: int, j: int) -> wp.vec3:
    """texels[i, j]; its gradient goes to gradients[i, j]."""
    return texels[i, j]


@wp.func_grad(read_vec3)
def adj_read_vec3(texels: wp.array2d[wp.vec3], gradients: wp.array2d[wp.vec3], i: int, j: int, adj_texel: wp.vec3):
    gradients[i, j] = adj_texel


@wp.func
def read_float(texels: wp.array2d[float], gradients: wp.array2d[float], i: int, j: int) -> float:
    """texels[i, j]; its gradient goes to gradients[i, j]."""
    return texels[i, j]


@wp.func_grad(read_float)
def adj_read_float(texels: wp.array2d[float], gradients: wp.array2d[float], i: int, j: int, adj_texel: float):
    gradients[i, j] = adj_texel


@wp.kernel(enable_backward=False)
def downsample_kernel(fine: wp.array2d[Any], coarse: wp.array2d[Any]):
    """coarse[i, j] is the mean of the 2 x 2 texels of `fine` below it."""
    i, j = wp.tid()
    top = fine[2 * i, 2 * j] + fine[2 * i, 2 * j + 1]
    bottom = fine[2 * i + 1, 2 * j] + fine[2 * i + 1, 2 * j + 1]
    coarse[i, j] = (top + bottom) * 0.25


wp.overload(downsample_kernel, [wp.array2d[float], wp.array2d[float]])
wp.overload(downsample_kernel, [wp.array2d[wp.vec3], wp.array2d[wp.vec3]])
