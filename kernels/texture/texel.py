"""A neural texture in any thread of any kernel: the features of a texel, and what the network makes of them."""

from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.texture.levels import Levels, place_of
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.kernels.texture.taps import make_taps


@cache
def make_params_type(network_type: Any) -> Any:
    """network: parameters of the texture's network. latents: words of `make_latent`, those of level m and grid g from
    `starts[m, g]` on, in the order of `Levels`. kernels: as `Layout` says."""

    @wp.struct
    class TextureParams:
        network: network_type
        levels: Levels
        latents: wp.array[wp.uint32]
        starts: wp.array2d[int]
        kernels: wp.array[float]

    return TextureParams


@cache
def make_latent(grid: Grid) -> wp.Function:
    """`(latents, start, i) -> latent`: number i of those packed from word `start` on, in `Grid.resident_bits` each,
    the low bits first: latent + limit, of 1 bit whether it is positive."""
    bits, each, mask = grid.resident_bits, 32 // grid.resident_bits, 2**grid.resident_bits - 1
    scale, low = (2.0, -1.0) if grid.bits == 1 else (1.0, -float(grid.limit))

    @wp.func
    def latent(latents: wp.array[wp.uint32], start: int, i: int) -> float:
        word = latents[start + i / each] >> wp.uint32(i % each * bits)
        return scale * float(word & wp.uint32(mask)) + low

    return latent


@cache
def make_add_grid(spec: TextureSpec, g: int, params_type: Any) -> wp.Function:
    """`(params, i, j, mip, x) -> x` with the grid's channels of texel (row i, column j)."""
    grid, taps, latent = spec.grids[g], make_taps(spec, g), make_latent(spec.grids[g])
    scale, channels = grid.scale, grid.channels
    first, vec_in = sum(each.channels for each in spec.grids[:g]), wp.types.vector(spec.n_in, float)

    @wp.func
    def add_grid(params: params_type, i: int, j: int, mip: int, x: vec_in) -> vec_in:
        row, column = i / scale, j / scale
        rows, columns = params.levels.rows[mip, g], params.levels.columns[mip, g]
        below = wp.where(row + 1 < rows, row + 1, 0)
        right = wp.where(column + 1 < columns, column + 1, 0)
        start = params.starts[mip, g]
        a, b = (row * columns + column) * channels, (row * columns + right) * channels
        c, d = (below * columns + column) * channels, (below * columns + right) * channels
        y = x
        for k in range(channels):
            q = wp.vec4(
                latent(params.latents, start, a + k),
                latent(params.latents, start, b + k),
                latent(params.latents, start, c + k),
                latent(params.latents, start, d + k),
            )
            y[first + k] = wp.dot(taps(params.kernels, k, i - row * scale, j - column * scale), q)
        return y

    return add_grid


@cache
def make_features(spec: TextureSpec, params_type: Any) -> wp.Function:
    """`(params, i, j, mip) -> x`, the network's input, for texel (row i, column j) of a level."""
    vec_in, detail = wp.types.vector(spec.n_in, float), spec.mips > 1

    @wp.func
    def start(params: params_type, i: int, j: int, mip: int) -> vec_in:
        x = vec_in()
        if wp.static(detail):
            x[wp.static(spec.n_in - 1)] = params.levels.detail[mip]
        return x

    features = start
    for g in range(len(spec.grids)):
        features = _after(features, make_add_grid(spec, g, params_type), params_type, vec_in)
    return features


def _after(before: wp.Function, add: wp.Function, params_type: Any, vec_in: type) -> wp.Function:
    @wp.func
    def both(params: params_type, i: int, j: int, mip: int) -> vec_in:
        return add(params, i, j, mip, before(params, i, j, mip))

    return both


@cache
def make_texel(spec: TextureSpec, network: wp.Function, params_type: Any) -> wp.Function:
    """`(params, i, j, mip) -> vec [channels]`: the network's results for texel (row i, column j) of a level; both wrap,
    and the level is the nearest that there is."""
    features = make_features(spec, params_type)
    vec_out = wp.types.vector(spec.channels, float)

    @wp.func
    def texel(params: params_type, i: int, j: int, mip: int) -> vec_out:
        place = place_of(params.levels, i, j, mip)
        return network(params.network, features(params, place[1], place[2], place[0]))

    return texel


@cache
def make_decode_kernel(texel: wp.Function, params_type: Any) -> wp.Kernel:
    """Texels from (top, left) on of a level to `values`. dim [height, width]."""

    @wp.kernel(module="unique", enable_backward=False)
    def decode_kernel(params: params_type, mip: int, top: int, left: int, values: wp.array3d[float]):
        i, j = wp.tid()
        y = texel(params, top + i, left + j, mip)
        for c in range(values.shape[2]):
            values[i, j, c] = y[c]

    return decode_kernel


Ranges = tuple[tuple[float, float, bool], ...]
"""low, high and whether logarithms, of each channel; see `warp_neural.texture.state.Map`"""


@cache
def make_store(ranges: Ranges) -> wp.Function:
    """`(y) -> vec`: the network's results, one for each of `ranges`, turned into what maps store."""
    channels = len(ranges)
    vec = wp.types.vector(channels, float)
    low, size = vec(*[a for a, _, _ in ranges]), vec(*[b - a for a, b, _ in ranges])
    hdr = vec(*[float(logarithm) for _, _, logarithm in ranges])

    @wp.func
    def store(y: vec) -> vec:
        result = vec()
        for c in range(channels):
            value = low[c] + wp.clamp(y[c], 0.0, 1.0) * size[c]
            if hdr[c] > 0.0:
                value = wp.max(wp.pow(2.0, value) - wp.pow(2.0, low[c]), 0.0)
            result[c] = value
        return result

    return store


@cache
def make_stored(texel: wp.Function, ranges: Ranges, params_type: Any) -> wp.Function:
    """`texel` with the network's results turned into what maps store."""
    store, vec = make_store(ranges), wp.types.vector(len(ranges), float)

    @wp.func
    def stored(params: params_type, i: int, j: int, mip: int) -> vec:
        return store(texel(params, i, j, mip))

    return stored
