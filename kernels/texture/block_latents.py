"""Latents in BC1 blocks, trained as the blocks have them: two ends and an index a latent; kernels of a step, for one
latent texture each.

A block's 22 parameters: red, green, blue of both ends, in steps of 5, 6 and 5 bits, and 16 indices by rows, 0 to 3 from
the first end to the second. While there is noise each has half a step of it; then they are rounded, straight through,
and what the network reads are the codes that a decoder of BC1 gives (`block_formats`). A latent texture is read as
GPUs read it: bilinearly, wrapping, with texel centres at (column + 0.5) / columns.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.nn.optimizers import adam
from warp_neural.kernels.nn.random import stream, uniform
from warp_neural.kernels.texture.features import NOISE
from warp_neural.kernels.texture.levels import TILE, TextureData, wrapped
from warp_neural.kernels.texture.spec import BLOCK_CHANNELS, BlockSpec
from warp_neural.kernels.texture.update import SETTINGS, corrections_of
from warp_neural.kernels.training.progress import Progress

PARAMETERS = wp.constant(2 * BLOCK_CHANNELS + 16)
INDICES = wp.constant(2 * BLOCK_CHANNELS)  # where they begin
STEPS = wp.constant(wp.vec3(31.0, 63.0, 31.0))
SPREAD = wp.constant(4.0)  # codes 0 to 255 are -2 to 2 in the network


@wp.struct
class BlockData:
    """Of one latent texture. levels: of each mip the rows and columns of its latents, the number of its first latent
    and of its first block. values [latents * 3]: as the network reads them, and their gradients. parameters
    [blocks * 22], their gradients and both moments."""

    levels: wp.array[wp.vec4i]
    values: wp.array[float]
    values_gradient: wp.array[float]
    parameters: wp.array[float]
    gradient: wp.array[float]
    first: wp.array[float]
    second: wp.array[float]


@wp.struct
class BlockTexel:
    """A latent as its block has it: ends in [0, 1], and the share of the second."""

    first: wp.vec3
    second: wp.vec3
    share: float
    value: wp.vec3


@wp.func
def expanded(code: wp.vec3) -> wp.vec3i:
    """5, 6, 5 bits to 8."""
    r, g, b = int(code[0]), int(code[1]), int(code[2])
    return wp.vec3i(r << 3 | r >> 2, g << 2 | g >> 4, b << 3 | b >> 2)


@wp.func
def block_texel(progress: Progress, data: TextureData, blocks: BlockData, g: int, block: int, texel: int) -> BlockTexel:
    """texel: of the block, 0 to 15."""
    step, p = progress.counters[0], block * PARAMETERS
    result = BlockTexel()
    index = blocks.parameters[p + INDICES + texel]
    for c in range(BLOCK_CHANNELS):
        result.first[c] = blocks.parameters[p + c]
        result.second[c] = blocks.parameters[p + BLOCK_CHANNELS + c]
    if step < data.noise_until:
        random = stream(progress.seed, step, block, NOISE)
        a, b = uniform(random, g * 8), uniform(random, g * 8 + 1)
        index += uniform(random, g * 8 + 2 + texel / 4)[texel % 4] - 0.5
        result.first += wp.vec3(a[0], a[1], a[2]) - wp.vec3(0.5)
        result.second += wp.vec3(a[3], b[0], b[1]) - wp.vec3(0.5)
        result.share = index / 3.0
        result.first = wp.cw_div(result.first, STEPS)
        result.second = wp.cw_div(result.second, STEPS)
        result.value = result.first + result.share * (result.second - result.first)
    else:
        for c in range(BLOCK_CHANNELS):
            result.first[c] = wp.rint(result.first[c])
            result.second[c] = wp.rint(result.second[c])
        near = int(wp.rint(index))
        mixed = ((3 - near) * expanded(result.first) + near * expanded(result.second)) / 3
        result.share = float(near) / 3.0
        for c in range(BLOCK_CHANNELS):
            result.value[c] = float(mixed[c]) / 255.0
        result.first = wp.cw_div(result.first, STEPS)
        result.second = wp.cw_div(result.second, STEPS)
    return result


@wp.func
def place_in(texel: int, texels: int, latents: int) -> float:
    """Where a texel's centre lies among latents: 0 is the centre of the first."""
    return (float(texel) + 0.5) * float(latents) / float(texels) - 0.5


@wp.func
def cyclic(i: int, n: int) -> int:
    """Any i into 0 to n - 1."""
    k = i % n
    return wp.where(k < 0, k + n, k)


@wp.func
def latent_of(data: TextureData, blocks: BlockData, tile: wp.vec3i, a: int, b: int) -> wp.vec2i:
    """Row and column of the latent (a, b) of those that a tile reads."""
    level, size = blocks.levels[tile[0]], data.levels.sizes[tile[0]]
    row = int(wp.floor(place_in(tile[1], size[0], level[0]))) + a
    column = int(wp.floor(place_in(tile[2], size[1], level[1]))) + b
    return wp.vec2i(cyclic(row, level[0]), cyclic(column, level[1]))


@wp.func
def block_of(level: wp.vec4i, row: int, column: int) -> int:
    return level[3] + row / 4 * ((level[1] + 3) / 4) + column / 4


def latents_side(scale: int) -> int:
    """That a tile reads, each way."""
    return TILE // scale + 2


def blocks_side(scale: int) -> int:
    return -(-latents_side(scale) // 4) + 1


@cache
def make_unblock_kernel(g: int) -> wp.Kernel:
    """Blocks to `values`. dim [tiles, latents of a side, latents of a side]."""

    @wp.kernel(module="unique", enable_backward=False)
    def unblock_kernel(progress: Progress, data: TextureData, blocks: BlockData, tiles: int):
        t, a, b = wp.tid()
        tile = data.tiles[progress.counters[0] * tiles + t]
        level, at = blocks.levels[tile[0]], latent_of(data, blocks, tile, a, b)
        texel = block_texel(progress, data, blocks, g, block_of(level, at[0], at[1]), at[0] % 4 * 4 + at[1] % 4)
        i = (level[2] + at[0] * level[1] + at[1]) * BLOCK_CHANNELS
        for c in range(BLOCK_CHANNELS):
            blocks.values[i + c] = texel.value[c]

    return unblock_kernel


@wp.struct
class Bilinear:
    """Of a texel: the first of the floats of the latents left above, right above, left below, right below, and their
    weights."""

    at: wp.vec4i
    weights: wp.vec4


@wp.func
def bilinear_of(data: TextureData, blocks: BlockData, tile: wp.vec3i, y: int, x: int) -> Bilinear:
    level, size = blocks.levels[tile[0]], data.levels.sizes[tile[0]]
    v = place_in(wrapped(tile[1] + y, size[0]), size[0], level[0])
    u = place_in(wrapped(tile[2] + x, size[1]), size[1], level[1])
    top, left = int(wp.floor(v)), int(wp.floor(u))
    fv, fu = v - float(top), u - float(left)
    result = Bilinear()
    for k in range(4):
        row, column = cyclic(top + k / 2, level[0]), cyclic(left + k % 2, level[1])
        result.at[k] = (level[2] + row * level[1] + column) * BLOCK_CHANNELS
    result.weights = wp.vec4((1.0 - fv) * (1.0 - fu), (1.0 - fv) * fu, fv * (1.0 - fu), fv * fu)
    return result


@cache
def make_block_features_kernel(spec: BlockSpec, g: int, dtype: type) -> wp.Kernel:
    """`values` to three columns of `encoded`. dim [tiles, TILE, TILE]."""
    first, detail = BLOCK_CHANNELS * g, spec.n_in - 1 if spec.mips > 1 and g == 0 else -1

    @wp.kernel(module="unique", enable_backward=False)
    def features_kernel(
        progress: Progress, data: TextureData, blocks: BlockData, tiles: int, encoded: wp.array2d[dtype]
    ):
        t, y, x = wp.tid()
        tile, i = data.tiles[progress.counters[0] * tiles + t], (t * TILE + y) * TILE + x
        taps = bilinear_of(data, blocks, tile, y, x)
        for c in range(BLOCK_CHANNELS):
            value = float(0.0)
            for k in range(4):
                value += taps.weights[k] * blocks.values[taps.at[k] + c]
            encoded[i, first + c] = dtype(SPREAD * (value - 0.5))
        if wp.static(detail >= 0):
            encoded[i, detail] = dtype(data.levels.detail[tile[0]])

    return features_kernel


@cache
def make_block_adjoint_kernel(spec: BlockSpec, g: int, dtype: type) -> wp.Kernel:
    """The gradients to `encoded` to those of `values`. dim [tiles, TILE, TILE]."""
    first = BLOCK_CHANNELS * g

    @wp.kernel(module="unique", enable_backward=False)
    def adjoint_kernel(
        progress: Progress, data: TextureData, blocks: BlockData, tiles: int, encoded: wp.array2d[dtype]
    ):
        t, y, x = wp.tid()
        tile, i = data.tiles[progress.counters[0] * tiles + t], (t * TILE + y) * TILE + x
        taps = bilinear_of(data, blocks, tile, y, x)
        for c in range(BLOCK_CHANNELS):
            gradient = SPREAD * float(encoded[i, first + c])
            for k in range(4):
                if taps.weights[k] != 0.0 and gradient != 0.0:
                    wp.atomic_add(blocks.values_gradient, taps.at[k] + c, taps.weights[k] * gradient)

    return adjoint_kernel


@cache
def make_block_gradient_kernel(g: int) -> wp.Kernel:
    """The gradients to `values` to those of the parameters. dim as of `unblock_kernel`; who finds one takes it."""

    @wp.kernel(module="unique", enable_backward=False)
    def gradient_kernel(progress: Progress, data: TextureData, blocks: BlockData, tiles: int):
        t, a, b = wp.tid()
        step = progress.counters[0]
        tile = data.tiles[step * tiles + t]
        level, at = blocks.levels[tile[0]], latent_of(data, blocks, tile, a, b)
        i = (level[2] + at[0] * level[1] + at[1]) * BLOCK_CHANNELS
        gradient = wp.vec3()
        for c in range(BLOCK_CHANNELS):
            gradient[c] = wp.atomic_exch(blocks.values_gradient, i + c, 0.0)
        if not wp.isfinite(gradient):
            progress.flags[step % 2] = 1
        elif wp.dot(gradient, gradient) > 0.0:
            block, k = block_of(level, at[0], at[1]), at[0] % 4 * 4 + at[1] % 4
            texel, p = block_texel(progress, data, blocks, g, block, k), block * PARAMETERS
            by_share = wp.dot(gradient, texel.second - texel.first)
            wp.atomic_add(blocks.gradient, p + INDICES + k, by_share / 3.0)
            for c in range(BLOCK_CHANNELS):
                by_end = gradient[c] / STEPS[c]
                wp.atomic_add(blocks.gradient, p + c, by_end * (1.0 - texel.share))
                wp.atomic_add(blocks.gradient, p + BLOCK_CHANNELS + c, by_end * texel.share)

    return gradient_kernel


@wp.kernel(enable_backward=False)
def block_update_kernel(progress: Progress, data: TextureData, blocks: BlockData, tiles: int, share: float):
    """Adam, where a step has reached a block. dim [tiles, blocks of a side, blocks of a side, 22]. share: of all
    blocks, that a step reaches."""
    t, a, b, k = wp.tid()
    step = progress.counters[1]
    parity = step % 2
    tile = data.tiles[step * tiles + t]
    level, size = blocks.levels[tile[0]], data.levels.sizes[tile[0]]
    row = int(wp.floor(wp.floor(place_in(tile[1], size[0], level[0])) / 4.0)) + a
    column = int(wp.floor(wp.floor(place_in(tile[2], size[1], level[1])) / 4.0)) + b
    columns = (level[1] + 3) / 4
    block = level[3] + cyclic(row, (level[0] + 3) / 4) * columns + cyclic(column, columns)
    i = block * PARAMETERS + k
    gradient = wp.atomic_exch(blocks.gradient, i, 0.0)
    if gradient != 0.0 and progress.flags[parity] == 0 and step < data.latents_until:
        state = wp.vec3(blocks.parameters[i], blocks.first[i], blocks.second[i])
        corrections = corrections_of(1.0 + float(step) * share)
        state = adam(gradient / progress.scale[parity], state, data.latent_rate[step], corrections, SETTINGS)
        most = float(3.0)
        if k < INDICES:
            most = STEPS[k % BLOCK_CHANNELS]
        blocks.parameters[i] = wp.clamp(state[0], 0.0, most)
        blocks.first[i] = state[1]
        blocks.second[i] = state[2]
