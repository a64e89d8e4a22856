"""Latents in BC1 blocks to the network's inputs and back: kernels of a training step, for one latent texture each."""

from functools import cache

import warp as wp

from warp_neural.kernels.nn.optimizers import adam
from warp_neural.kernels.texture.block_latents import (
    INDICES,
    LAST_INDEX,
    PARAMETERS,
    SPREAD,
    STEPS,
    BlockData,
    bilinear_of,
    block_of,
    block_texel,
    latent_of,
    place_in,
)
from warp_neural.kernels.texture.levels import TILE, TextureData, cyclic
from warp_neural.kernels.texture.spec import BLOCK_CHANNELS
from warp_neural.kernels.texture.update import SETTINGS, corrections_of
from warp_neural.kernels.training.progress import Progress


@wp.kernel(module="unique", enable_backward=False)
def unblock_kernel(progress: Progress, data: TextureData, blocks: BlockData, tiles: int, g: int):
    """Blocks to `values`. dim [tiles, latents of a side, latents of a side]. g: number of the latent texture."""
    t, a, b = wp.tid()
    tile = data.tiles[progress.counters[0] * tiles + t]
    level, at = blocks.levels[tile[0]], latent_of(data, blocks, tile, a, b)
    texel = block_texel(progress, data, blocks, g, block_of(level, at[0], at[1]), at[0] % 4 * 4 + at[1] % 4)
    i = (level[2] + at[0] * level[1] + at[1]) * BLOCK_CHANNELS
    for c in range(BLOCK_CHANNELS):
        blocks.values[i + c] = texel.value[c]


@cache
def make_block_features_kernel(dtype: type) -> wp.Kernel:
    """`values` to three columns of `encoded`, the last of which has the level of detail if there are mips. dim [tiles,
    TILE, TILE]."""

    @wp.kernel(module="unique", enable_backward=False)
    def features_kernel(
        progress: Progress, data: TextureData, blocks: BlockData, tiles: int, g: int, encoded: wp.array2d[dtype]
    ):
        t, y, x = wp.tid()
        tile, i = data.tiles[progress.counters[0] * tiles + t], (t * TILE + y) * TILE + x
        taps, first = bilinear_of(data, blocks, tile, y, x), BLOCK_CHANNELS * g
        for c in range(BLOCK_CHANNELS):
            value = float(0.0)
            for k in range(4):
                value += taps.weights[k] * blocks.values[taps.at[k] + c]
            encoded[i, first + c] = dtype(SPREAD * (value - 0.5))
        if g == 0 and data.levels.sizes.shape[0] > 1:
            encoded[i, encoded.shape[1] - 1] = dtype(data.levels.detail[tile[0]])

    return features_kernel


@cache
def make_block_adjoint_kernel(dtype: type) -> wp.Kernel:
    """The gradients to `encoded` to those of `values`. dim [tiles, TILE, TILE]."""

    @wp.kernel(module="unique", enable_backward=False)
    def adjoint_kernel(
        progress: Progress, data: TextureData, blocks: BlockData, tiles: int, g: int, encoded: wp.array2d[dtype]
    ):
        t, y, x = wp.tid()
        tile, i = data.tiles[progress.counters[0] * tiles + t], (t * TILE + y) * TILE + x
        taps, first = bilinear_of(data, blocks, tile, y, x), BLOCK_CHANNELS * g
        for c in range(BLOCK_CHANNELS):
            gradient = SPREAD * float(encoded[i, first + c])
            for k in range(4):
                if taps.weights[k] != 0.0 and gradient != 0.0:
                    wp.atomic_add(blocks.values_gradient, taps.at[k] + c, taps.weights[k] * gradient)

    return adjoint_kernel


@wp.kernel(module="unique", enable_backward=False)
def gradient_kernel(progress: Progress, data: TextureData, blocks: BlockData, tiles: int, g: int):
    """The gradients to `values` to those of the parameters. dim as of `unblock_kernel`; who finds one takes it."""
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
        wp.atomic_add(blocks.gradient, p + INDICES + k, by_share / LAST_INDEX)
        for c in range(BLOCK_CHANNELS):
            by_end = gradient[c] / STEPS[c]
            wp.atomic_add(blocks.gradient, p + c, by_end * (1.0 - texel.share))
            wp.atomic_add(blocks.gradient, p + BLOCK_CHANNELS + c, by_end * texel.share)


@wp.kernel(module="unique", enable_backward=False)
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
        most = float(LAST_INDEX)
        if k < INDICES:
            most = STEPS[k % BLOCK_CHANNELS]
        blocks.parameters[i] = wp.clamp(state[0], 0.0, most)
        blocks.first[i] = state[1]
        blocks.second[i] = state[2]
