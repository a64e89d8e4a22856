"""The maps of a texture in block formats, read together: of any texel the channels that a neural texture gives."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from warp_neural.kernels.texture.block_formats import bc1_texel, bc3_texel, bc4_texel, bc5_texel, bc7_texel
from warp_neural.kernels.texture.levels import Levels, place_of


@dataclass(frozen=True)
class BlockMap:
    """format: as `READ` has it. components: of the format's red, green, blue and alpha those that are channels of the
    texture, in their order."""

    format: str
    components: tuple[int, ...]


@wp.struct
class BlockParams:
    """words: blocks of all maps and levels, those of map n, level m from first[n, m] on."""

    levels: Levels
    words: wp.array[wp.uint32]
    first: wp.array2d[int]


@wp.func
def read_bc1(words: wp.array[wp.uint32], first: int, width: int, i: int, j: int) -> wp.vec4:
    c = bc1_texel(words, first, (width + 3) / 4, i, j)
    return wp.vec4(float(c[0]), float(c[1]), float(c[2]), 255.0) / 255.0


@wp.func
def read_bc3(words: wp.array[wp.uint32], first: int, width: int, i: int, j: int) -> wp.vec4:
    return wp.vec4(bc3_texel(words, first, (width + 3) / 4, i, j)) / 255.0


@wp.func
def read_bc4(words: wp.array[wp.uint32], first: int, width: int, i: int, j: int) -> wp.vec4:
    return wp.vec4(float(bc4_texel(words, first, (width + 3) / 4, i, j)) / 255.0, 0.0, 0.0, 1.0)


@wp.func
def read_bc5(words: wp.array[wp.uint32], first: int, width: int, i: int, j: int) -> wp.vec4:
    """Normals: the third is stored z >= 0 of a unit vector of the first two, all as (x + 1) / 2."""
    c = bc5_texel(words, first, (width + 3) / 4, i, j)
    x, y = float(c[0]) / 255.0, float(c[1]) / 255.0
    z = wp.sqrt(wp.max(1.0 - (2.0 * x - 1.0) * (2.0 * x - 1.0) - (2.0 * y - 1.0) * (2.0 * y - 1.0), 0.0))
    return wp.vec4(x, y, 0.5 * z + 0.5, 1.0)


@wp.func
def read_bc7(words: wp.array[wp.uint32], first: int, width: int, i: int, j: int) -> wp.vec4:
    return wp.vec4(bc7_texel(words, first, (width + 3) / 4, i, j)) / 255.0


@wp.func
def half_of(word: wp.uint32, upper: bool) -> float:
    bits = wp.where(upper, word >> wp.uint32(16), word & wp.uint32(0xFFFF))
    return float(wp.cast(wp.uint16(bits), wp.float16))


@wp.func
def read_half1(words: wp.array[wp.uint32], first: int, width: int, i: int, j: int) -> wp.vec4:
    at = i * width + j
    return wp.vec4(half_of(words[first + at / 2], at % 2 == 1), 0.0, 0.0, 1.0)


@wp.func
def read_half4(words: wp.array[wp.uint32], first: int, width: int, i: int, j: int) -> wp.vec4:
    at = first + 2 * (i * width + j)
    a, b = words[at], words[at + 1]
    return wp.vec4(half_of(a, False), half_of(a, True), half_of(b, False), half_of(b, True))


READ = {
    "bc1": read_bc1, "bc3": read_bc3, "bc4": read_bc4, "bc5": read_bc5, "bc7": read_bc7,
    "half1": read_half1, "half4": read_half4,
}  # fmt: skip
"""`(words, first, width, i, j) -> vec4` of each format, as stored."""


@cache
def make_block_texel(maps: tuple[BlockMap, ...]) -> wp.Function:
    """`(params: BlockParams, i, j, mip) -> vec`: as a neural texture's `texel`, the channels of all maps as stored."""
    vec, at = wp.types.vector(sum(len(each.components) for each in maps), float), 0
    read = _start(vec)
    for n, each in enumerate(maps):
        read = _after(read, each, n, at, vec)
        at += len(each.components)

    @wp.func
    def texel(params: BlockParams, i: int, j: int, mip: int) -> vec:
        return read(params, place_of(params.levels, i, j, mip))

    return texel


def _start(vec: type) -> wp.Function:
    @wp.func
    def start(params: BlockParams, place: wp.vec3i) -> vec:
        return vec()

    return start


def _after(before: wp.Function, each: BlockMap, n: int, at: int, vec: type) -> wp.Function:
    read, components, size = READ[each.format], wp.types.vector(max(len(each.components), 1), int), len(each.components)
    which = components(*(each.components or (0,)))

    @wp.func
    def both(params: BlockParams, place: wp.vec3i) -> vec:
        y = before(params, place)
        if wp.static(size > 0):
            width = params.levels.sizes[place[0]][1]
            value = read(params.words, params.first[n, place[0]], width, place[1], place[2])
            for c in range(size):
                y[at + c] = value[which[c]]
        return y

    return both
