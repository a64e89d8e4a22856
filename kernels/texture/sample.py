"""The sample function of a texture's training: which texel, and what it is."""

from functools import cache

import warp as wp

from warp_neural.kernels.nn.random import Stream
from warp_neural.kernels.texture.levels import TILE, TextureData, wrapped
from warp_neural.kernels.texture.spec import TextureSpec


@cache
def make_sample(spec: TextureSpec, tiles: int, vec_in: type) -> wp.Function:
    """`(index, random, data) -> (x, target)` as a `Trainer` takes it; x is not used, the network reads `encoded`."""
    n_out, vec_out = spec.channels, wp.types.vector(spec.channels, float)

    @wp.func
    def sample(index: int, random: Stream, data: TextureData):
        t = index / wp.static(TILE * TILE)
        i = index - t * wp.static(TILE * TILE)
        tile = data.tiles[int(random.step) * tiles + t]
        level, padded, size = tile[0], data.levels.padded[tile[0]], data.levels.sizes[tile[0]]
        row = wrapped(tile[1] + i / TILE, padded[0])
        column = wrapped(tile[2] + i % TILE, padded[1])
        target = vec_out(wp.nan)
        if row < size[0] and column < size[1]:
            at = data.levels.texels[level] + row * size[1] + column
            for c in range(n_out):
                target[c] = data.targets[at, c]
        return vec_in(), target

    return sample
