"""A texture with latents in BC1 blocks in any thread of any kernel: latents as GPUs filter them, then the network."""

from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.texture.block_formats import bc1_texel
from warp_neural.kernels.texture.block_latents import SPREAD
from warp_neural.kernels.texture.levels import Levels, cyclic, place_of
from warp_neural.kernels.texture.spec import BLOCK_CHANNELS, DETAIL_SCALE, BlockSpec
from warp_neural.kernels.texture.texel import Ranges, make_store


@cache
def make_block_params_type(network_type: Any) -> Any:
    """network: parameters of the texture's network. words: blocks of all latent textures, those of level m and latent
    texture g from `first[m, g]` on."""

    @wp.struct
    class BlockTextureParams:
        network: network_type
        levels: Levels
        words: wp.array[wp.uint32]
        first: wp.array2d[int]

    return BlockTextureParams


@wp.func
def latent_at(words: wp.array[wp.uint32], first: int, size: wp.vec2i, row: int, column: int) -> wp.vec3:
    """0 to 1. size: rows and columns of the level, around which both wrap."""
    code = bc1_texel(words, first, (size[1] + 3) / 4, cyclic(row, size[0]), cyclic(column, size[1]))
    return wp.vec3(float(code[0]), float(code[1]), float(code[2])) / 255.0


@wp.func
def bilinear_latents(words: wp.array[wp.uint32], first: int, size: wp.vec2i, uv: wp.vec2) -> wp.vec3:
    """0 to 1, as textures with linear filters and repeating addresses are read. Gradients go to uv."""
    x, y = uv[0] * float(size[1]) - 0.5, uv[1] * float(size[0]) - 0.5
    row, column = int(wp.floor(y)), int(wp.floor(x))
    fx, fy = x - wp.floor(x), y - wp.floor(y)
    upper = wp.lerp(latent_at(words, first, size, row, column), latent_at(words, first, size, row, column + 1), fx)
    row += 1
    lower = wp.lerp(latent_at(words, first, size, row, column), latent_at(words, first, size, row, column + 1), fx)
    return wp.lerp(upper, lower, fy)


@wp.func_grad(bilinear_latents)
def adj_bilinear_latents(words: wp.array[wp.uint32], first: int, size: wp.vec2i, uv: wp.vec2, adj_ret: wp.vec3):
    x, y = uv[0] * float(size[1]) - 0.5, uv[1] * float(size[0]) - 0.5
    row, column = int(wp.floor(y)), int(wp.floor(x))
    fx, fy = x - wp.floor(x), y - wp.floor(y)
    a, b = latent_at(words, first, size, row, column), latent_at(words, first, size, row, column + 1)
    c, d = latent_at(words, first, size, row + 1, column), latent_at(words, first, size, row + 1, column + 1)
    across, down = wp.lerp(b - a, d - c, fy), wp.lerp(c - a, d - b, fx)
    wp.adjoint[uv] += wp.vec2(wp.dot(adj_ret, across) * float(size[1]), wp.dot(adj_ret, down) * float(size[0]))


@cache
def make_latents(spec: BlockSpec, params_type: Any) -> wp.Function:
    """`(params, uv, mip) -> x`: the network's inputs at a level, but for the level of detail."""
    vec_in = wp.types.vector(spec.n_in, float)

    @wp.func
    def start(params: params_type, uv: wp.vec2, mip: int) -> vec_in:
        return vec_in()

    latents = start
    for g, scale in enumerate(spec.scales):
        latents = _after(latents, spec, g, scale, params_type)
    return latents


def _after(before: wp.Function, spec: BlockSpec, g: int, scale: int, params_type: Any) -> wp.Function:
    """`before`, and the channels of latent texture g."""
    vec_in = wp.types.vector(spec.n_in, float)
    rows, columns, first = spec.height // scale, spec.width // scale, BLOCK_CHANNELS * g

    @wp.func
    def latents(params: params_type, uv: wp.vec2, mip: int) -> vec_in:
        x = before(params, uv, mip)
        size = wp.vec2i(wp.max(rows >> mip, 1), wp.max(columns >> mip, 1))
        value = bilinear_latents(params.words, params.first[mip, g], size, uv)
        for c in range(BLOCK_CHANNELS):
            x[first + c] = SPREAD * (value[c] - 0.5)
        return x

    return latents


@cache
def make_block_texel(spec: BlockSpec, network: wp.Function, params_type: Any) -> wp.Function:
    """`(params, i, j, mip) -> vec [channels]`: the network's results at the centre of a texel, as `make_texel` has
    them."""
    latents, vec_out = make_latents(spec, params_type), wp.types.vector(spec.channels, float)
    detailed, detail = spec.mips > 1, spec.n_in - 1

    @wp.func
    def texel(params: params_type, i: int, j: int, mip: int) -> vec_out:
        place = place_of(params.levels, i, j, mip)
        level, size = place[0], params.levels.sizes[place[0]]
        uv = wp.vec2((float(place[2]) + 0.5) / float(size[1]), (float(place[1]) + 0.5) / float(size[0]))
        x = latents(params, uv, level)
        if wp.static(detailed):
            x[wp.static(detail)] = params.levels.detail[level]
        return network(params.network, x)

    return texel


@cache
def make_block_sample(spec: BlockSpec, network: wp.Function, ranges: Ranges, params_type: Any) -> wp.Function:
    """`(params, uv, lod) -> vec`: latents bilinearly from the two levels beside `lod`, blended, then the network once,
    as maps store it. Gradients go to uv and lod."""
    latents, store, vec = make_latents(spec, params_type), make_store(ranges), wp.types.vector(spec.channels, float)
    last, detail = spec.mips - 1, spec.n_in - 1

    @wp.func
    def sample(params: params_type, uv: wp.vec2, lod: float) -> vec:
        level = wp.clamp(lod, 0.0, float(last))
        mip = wp.clamp(int(level), 0, last)  # of NaN too
        x = latents(params, uv, mip)
        if wp.static(last > 0):
            x = wp.lerp(x, latents(params, uv, wp.min(mip + 1, last)), level - float(mip))
            x[wp.static(detail)] = level / float(DETAIL_SCALE)
        return store(network(params.network, x))

    return sample
