"""Latents in BC1 blocks, trained as the blocks have them: two ends and an index a latent.

A block's 22 parameters: red, green, blue of both ends, in steps of 5, 6 and 5 bits, and 16 indices by rows, 0 to 3 from
the first end to the second. While there is noise each has half a step of it; then they are rounded, straight through,
and what the network reads are the codes that a decoder of BC1 gives (`block_formats`). A latent texture is read as
GPUs read it: bilinearly, wrapping, with texel centres at (column + 0.5) / columns.
"""

import warp as wp

from warp_neural.kernels.nn.random import stream, uniform
from warp_neural.kernels.texture.block_formats import expand_565
from warp_neural.kernels.texture.features import NOISE
from warp_neural.kernels.texture.levels import TILE, TextureData, cyclic, wrapped
from warp_neural.kernels.texture.spec import BLOCK_CHANNELS
from warp_neural.kernels.training.progress import Progress

PARAMETERS = wp.constant(2 * BLOCK_CHANNELS + 16)
INDICES = wp.constant(2 * BLOCK_CHANNELS)  # where they begin
STEPS = wp.constant(wp.vec3(31.0, 63.0, 31.0))
LAST_INDEX = wp.constant(3.0)
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
def rounded(ends: wp.vec3) -> wp.vec3:
    return wp.vec3(wp.rint(ends[0]), wp.rint(ends[1]), wp.rint(ends[2]))


@wp.func
def colour(end: wp.vec3) -> wp.vec3i:
    """8-bit codes of whole numbers of 5, 6 and 5 bits."""
    return expand_565(int(end[0]) << 11 | int(end[1]) << 5 | int(end[2]))


@wp.func
def block_texel(progress: Progress, data: TextureData, blocks: BlockData, g: int, block: int, texel: int) -> BlockTexel:
    """texel: of the block, 0 to 15."""
    step, p = progress.counters[0], block * PARAMETERS
    index, first, second = float(blocks.parameters[p + INDICES + texel]), wp.vec3(), wp.vec3()
    for c in range(BLOCK_CHANNELS):
        first[c] = blocks.parameters[p + c]
        second[c] = blocks.parameters[p + BLOCK_CHANNELS + c]
    result = BlockTexel()
    if step < data.noise_until:
        random = stream(progress.seed, step, block, NOISE)
        a, b = uniform(random, g * 8), uniform(random, g * 8 + 1)
        index += uniform(random, g * 8 + 2 + texel / 4)[texel % 4] - 0.5
        first += wp.vec3(a[0], a[1], a[2]) - wp.vec3(0.5)
        second += wp.vec3(a[3], b[0], b[1]) - wp.vec3(0.5)
        result.value = wp.cw_div(first + index / LAST_INDEX * (second - first), STEPS)
    else:
        index, first, second = wp.rint(index), rounded(first), rounded(second)
        mixed = ((3 - int(index)) * colour(first) + int(index) * colour(second)) / 3
        result.value = wp.vec3(float(mixed[0]), float(mixed[1]), float(mixed[2])) / 255.0
    result.first = wp.cw_div(first, STEPS)
    result.second = wp.cw_div(second, STEPS)
    result.share = index / LAST_INDEX
    return result


@wp.func
def place_in(texel: int, texels: int, latents: int) -> float:
    """Where a texel's centre lies among latents: 0 is the centre of the first."""
    return (float(texel) + 0.5) * float(latents) / float(texels) - 0.5


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
