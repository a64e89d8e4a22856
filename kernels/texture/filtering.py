"""A neural texture at any place: filtered exactly, or by one texel whose mean is the filtered value."""

from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.errors import require
from warp_neural.kernels.texture.filters import ellipse
from warp_neural.kernels.texture.levels import Levels
from warp_neural.kernels.texture.spec import TextureSpec


@wp.struct
class Tap:
    """One of the eight texels of a trilinear read. weights, slopes: the factors of its weight, across, down and between
    levels, and their derivatives by u, v and the level of detail."""

    row: int
    column: int
    mip: int
    weights: wp.vec3
    slopes: wp.vec3


@wp.func
def tap_of(levels: Levels, uv: wp.vec2, level: float, last: int, k: int) -> Tap:
    """k: 0 to 7; bit 0 is right, bit 1 below, bit 2 the coarser level. last: the coarsest one."""
    right, below, coarser = k % 2, k / 2 % 2, k / 4
    tap = Tap()
    tap.mip = wp.clamp(int(level) + coarser, 0, last)  # of NaN too
    size = levels.sizes[tap.mip]
    width, height = float(size[1]), float(size[0])
    x, y = uv[0] * width - 0.5, uv[1] * height - 0.5
    f = wp.vec3(x - wp.floor(x), y - wp.floor(y), level - wp.floor(level))
    far = wp.vec3(float(right), float(below), float(coarser))  # 1 where the weight rises
    tap.row = int(wp.floor(y)) + below
    tap.column = int(wp.floor(x)) + right
    for c in range(3):
        tap.weights[c] = wp.where(far[c] > 0.0, f[c], 1.0 - f[c])
    tap.slopes = wp.cw_mul(2.0 * far - wp.vec3(1.0), wp.vec3(width, height, 1.0))
    return tap


@cache
def make_sample(texel: wp.Function, spec: TextureSpec, params_type: Any) -> wp.Function:
    """`(params, uv, lod) -> vec`: trilinear. Gradients go to uv and lod: not through Warp's own adjoint, which keeps no
    state of loops, and not to params. At the seams between texels they are those of the side with the larger uv."""
    vec, last = wp.types.vector(spec.channels, float), spec.mips - 1

    @wp.func
    def sample(params: params_type, uv: wp.vec2, lod: float) -> vec:
        level = wp.clamp(lod, 0.0, float(last))
        total = vec()
        k = int(0)
        while k < 8:  # not unrolled: one copy of the network
            tap = tap_of(params.levels, uv, level, last, k)
            weight = tap.weights[0] * tap.weights[1] * tap.weights[2]
            if weight > 0.0:
                total += weight * texel(params, tap.row, tap.column, tap.mip)
            k += 1
        return total

    @wp.func_grad(sample)
    def adj_sample(params: params_type, uv: wp.vec2, lod: float, adj_ret: vec):
        level = wp.clamp(lod, 0.0, float(last))
        gradient = wp.vec3()
        k = int(0)
        while k < 8:
            tap = tap_of(params.levels, uv, level, last, k)
            w, slopes = tap.weights, tap.slopes
            by_weight = wp.dot(adj_ret, texel(params, tap.row, tap.column, tap.mip))
            others = wp.vec3(w[1] * w[2], w[0] * w[2], w[0] * w[1])
            gradient += by_weight * wp.cw_mul(slopes, others)
            k += 1
        wp.adjoint[uv] += wp.vec2(gradient[0], gradient[1])
        if lod >= 0.0 and lod < float(last):
            wp.adjoint[lod] += gradient[2]

    return sample


@cache
def make_sampler(texel: wp.Function, filter: wp.Function, spec: TextureSpec, params_type: Any) -> wp.Function:
    """`(params, uv, footprint, random) -> vec`: one texel, and one evaluation of the network, by chance.

    filter: of `kernels.texture.filters`. footprint: as `ellipse` has it. random: four numbers in [0, 1), for the
    texel across and down, the level, and the place on the line. No gradients: which texel it is has none. Raises
    `InputError` for a filter that is no `wp.Function`.
    """
    require(
        isinstance(filter, wp.Function), "filter", filter, "nearest, bilinear, bicubic, gaussian(sigma) or a @wp.func"
    )
    vec, last = wp.types.vector(spec.channels, float), spec.mips - 1

    @wp.func
    def sample(params: params_type, uv: wp.vec2, footprint: wp.mat22, random: wp.vec4) -> vec:
        lod, line = ellipse(footprint, params.levels.sizes[0])
        at = uv + line * (random[3] - 0.5)
        mip = wp.clamp(int(wp.min(lod, float(last)) + random[2]), 0, last)  # the coarser one as often as its weight
        size = params.levels.sizes[mip]
        row, column = filter(at[1] * float(size[0]), random[1]), filter(at[0] * float(size[1]), random[0])
        return texel(params, row, column, mip)

    @wp.func_grad(sample)
    def adj_sample(params: params_type, uv: wp.vec2, footprint: wp.mat22, random: wp.vec4, adj_ret: vec):
        pass  # Warp's own would compile the network's adjoint for nothing

    return sample
