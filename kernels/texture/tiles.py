"""Tiles of a texture in memory: codes of 8 or 16 bits, or BC4 blocks of each channel, which take 4."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.texture.block_formats import bc4_value
from warp_neural.kernels.texture.codes import Codes, make_pack, make_unpack


@dataclass(frozen=True)
class Tiles:
    """tile: texels a side, a multiple of 4. A slot has some more to the right and below, of the next tiles, or of the
    first ones where the level wraps, so that bilinear reads stay inside: `side` texels a side."""

    channels: int
    bits: int
    tile: int

    @property
    def side(self) -> int:
        return self.tile + (4 if self.bits == 4 else 1)

    @property
    def codes(self) -> Codes:
        """Of a texel, or of one that is to be part of a block."""
        return Codes(self.channels, max(self.bits, 8))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows of words that a slot has, one for each texel or block, and words of 32 bits of each."""
        return ((self.side // 4) ** 2, 2 * self.channels) if self.bits == 4 else (self.side**2, self.codes.words)


@cache
def make_read(tiles: Tiles) -> wp.Function:
    """`(words, slot, i, j) -> vec`: row i, column j of a slot."""
    return _make_read_blocks(tiles) if tiles.bits == 4 else _make_read_codes(tiles)


def _make_read_codes(tiles: Tiles) -> wp.Function:
    vec, side, unpack = tiles.codes.vec, tiles.side, make_unpack(tiles.codes)

    @wp.func
    def read(words: wp.array2d[wp.uint32], slot: int, i: int, j: int) -> vec:
        return unpack(words, (slot * side + i) * side + j)

    return read


def _make_read_blocks(tiles: Tiles) -> wp.Function:
    vec, channels, blocks = tiles.codes.vec, tiles.channels, tiles.side // 4

    @wp.func
    def read(words: wp.array2d[wp.uint32], slot: int, i: int, j: int) -> vec:
        at, texel = (slot * blocks + i / 4) * blocks + j / 4, i % 4 * 4 + j % 4
        y = vec()
        for c in range(channels):
            y[c] = float(bc4_value(words[at, 2 * c], words[at, 2 * c + 1], texel)) / 255.0
        return y

    return read


@cache
def make_decode_tiles_kernel(tiles: Tiles, texel: wp.Function, params_type: Any) -> wp.Kernel:
    """jobs [n, 4]: level, first row, first column, and the slot in `words`. dim [n, side, side]"""
    side, pack = tiles.side, make_pack(tiles.codes)

    @wp.kernel(module="unique", enable_backward=False)
    def decode_tiles_kernel(params: params_type, jobs: wp.array2d[int], words: wp.array2d[wp.uint32]):
        n, i, j = wp.tid()
        y = texel(params, jobs[n, 1] + i, jobs[n, 2] + j, jobs[n, 0])
        pack(y, words, (jobs[n, 3] * side + i) * side + j)

    return decode_tiles_kernel


@cache
def make_encode_tiles_kernel(tiles: Tiles) -> wp.Kernel:
    """Codes of slots 0 to n - 1 to BC4, seven steps from the largest code of a block to the smallest, in the slots
    `slots` [n] of `words`. dim [n, side / 4, side / 4, channels]"""
    side, blocks, vec16 = tiles.side, tiles.side // 4, wp.types.vector(16, int)

    @wp.kernel(module="unique", enable_backward=False)
    def encode_tiles_kernel(codes: wp.array2d[wp.uint32], slots: wp.array[int], words: wp.array2d[wp.uint32]):
        n, i, j, c = wp.tid()
        values, most, least = vec16(), int(0), int(255)
        for t in range(16):
            word = codes[(n * side + 4 * i + t / 4) * side + 4 * j + t % 4, c / 4]
            values[t] = int(word >> wp.uint32(8 * (c % 4))) & 255
            most, least = wp.max(most, values[t]), wp.min(least, values[t])
        span = wp.max(most - least, 1)
        block = wp.uint64(most | least << 8)
        for t in range(16):
            step = (14 * (most - values[t]) + span) / (2 * span)
            index = wp.where(step == 0, 0, wp.where(step == 7, 1, step + 1))
            block = block | wp.uint64(index) << wp.uint64(16 + 3 * t)
        at = (slots[n] * blocks + i) * blocks + j
        words[at, 2 * c] = wp.uint32(block)
        words[at, 2 * c + 1] = wp.uint32(block >> wp.uint64(32))

    return encode_tiles_kernel
