"""The network's results of many texels in memory, in 8 or 16 bits a channel, from 0 as 0 to 1 as the largest code."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.texture.levels import Levels, place_of


@dataclass(frozen=True)
class Codes:
    """Of a texel: `words` words of 32 bits, channels from the low bits of the first on."""

    channels: int
    bits: int

    @property
    def words(self) -> int:
        return -(-self.channels * self.bits // 32)

    @property
    def vec(self) -> type:
        return wp.types.vector(self.channels, float)


@wp.struct
class CodesParams:
    """Of all texels of a texture: words [texels of all levels, words of a texel], as `Levels.texels` has them."""

    levels: Levels
    words: wp.array2d[wp.uint32]


@cache
def make_pack(codes: Codes) -> wp.Function:
    """`(y: vec, words, at: int)`: into row `at`, rounded."""
    vec, bits, each, most = codes.vec, codes.bits, 32 // codes.bits, float(2**codes.bits - 1)
    channels, n = codes.channels, codes.words

    @wp.func
    def pack(y: vec, words: wp.array2d[wp.uint32], at: int):
        for w in range(n):
            word = wp.uint32(0)
            for k in range(each):
                c = w * each + k
                if c < channels:
                    word = word | wp.uint32(wp.clamp(y[c], 0.0, 1.0) * most + 0.5) << wp.uint32(k * bits)
            words[at, w] = word

    return pack


@cache
def make_unpack(codes: Codes) -> wp.Function:
    """`(words, at: int) -> vec` of row `at`."""
    vec, bits, each, most = codes.vec, codes.bits, 32 // codes.bits, 2**codes.bits - 1
    channels, n = codes.channels, codes.words

    @wp.func
    def unpack(words: wp.array2d[wp.uint32], at: int) -> vec:
        y = vec()
        for w in range(n):
            word = words[at, w]
            for k in range(each):
                c = w * each + k
                if c < channels:
                    y[c] = float(word >> wp.uint32(k * bits) & wp.uint32(most)) / float(most)
        return y

    return unpack


@cache
def make_codes_texel(codes: Codes) -> wp.Function:
    """`(params: CodesParams, i, j, mip) -> vec`: as a neural texture's, see `make_texel`."""
    unpack, vec = make_unpack(codes), codes.vec

    @wp.func
    def texel(params: CodesParams, i: int, j: int, mip: int) -> vec:
        place = place_of(params.levels, i, j, mip)
        first, columns = params.levels.texels[place[0]], params.levels.sizes[place[0]][1]
        return unpack(params.words, first + place[1] * columns + place[2])

    return texel


@cache
def make_fill_kernel(codes: Codes, texel: wp.Function, params_type: Any) -> wp.Kernel:
    """Every texel of a level into `target.words`. dim [height, width]"""
    pack = make_pack(codes)

    @wp.kernel(module="unique", enable_backward=False)
    def fill_kernel(params: params_type, mip: int, target: CodesParams):
        i, j = wp.tid()
        at = target.levels.texels[mip] + i * target.levels.sizes[mip][1] + j
        pack(texel(params, i, j, mip), target.words, at)

    return fill_kernel
