"""A texture in tiles of which some are in memory: a table of pages, samples that say what they miss, decoding.

Virtual texturing with feedback: Barrett, "Sparse Virtual Textures", GDC 2008; Mittring, "Advanced Virtual Texture
Topics", SIGGRAPH 2008 courses. A page is a tile of `tile` x `tile` texels of a level; pages are numbered from the
coarsest level to the finest, by rows. One that is in memory has a slot, of tile + 1 texels a side: the last row and
column are those of the next tiles, or of the first ones where the level wraps, so that bilinear reads stay inside.
"""

from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.texture.codes import Codes, make_pack, make_unpack
from warp_neural.kernels.texture.levels import Levels, place_of
from warp_neural.kernels.texture.texel import make_stored


@wp.struct
class PageParams:
    """first [mips]: the number of each level's first page; columns [mips]: pages a row. slots [pages]: where each is,
    -1 if nowhere; the coarsest level is always somewhere. wanted [pages]: 1 for those that were asked for, or read in
    place of these. words [slots * (tile + 1)^2, words of a texel]."""

    levels: Levels
    first: wp.array[int]
    columns: wp.array[int]
    slots: wp.array[int]
    wanted: wp.array[int]
    words: wp.array2d[wp.uint32]


@wp.struct
class Place:
    """Row `at` of `words` has the upper left of four texels, of level `mip`; x, y: from it to the point, 0 to 1."""

    at: int
    mip: int
    x: float
    y: float


@wp.func
def want(wanted: wp.array[int], page: int):
    if wanted[page] == 0:  # all write the same
        wanted[page] = 1


@cache
def make_locate(tile: int) -> wp.Function:
    """`(params, row, column, mip, asked: bool) -> int`: the row of `words` that has a texel, below 0 if its page is in
    no slot. asked: for this level, and not in place of a finer one."""

    @wp.func
    def locate(params: PageParams, row: int, column: int, mip: int, asked: bool) -> int:
        page = params.first[mip] + row / tile * params.columns[mip] + column / tile
        slot = params.slots[page]
        if asked or slot >= 0:
            want(params.wanted, page)
        return (slot * (tile + 1) + row % tile) * (tile + 1) + column % tile

    return locate


@cache
def make_find(tile: int) -> wp.Function:
    """`(params, uv, mip) -> Place`: in that level, or, if the page is in no slot, in the finest coarser one that is."""
    locate = make_locate(tile)

    @wp.func
    def find(params: PageParams, uv: wp.vec2, mip: int) -> Place:
        place, m = Place(), int(mip)
        place.at = -1
        while place.at < 0 and m < params.levels.sizes.shape[0]:
            size = params.levels.sizes[m]
            x, y = uv[0] * float(size[1]) - 0.5, uv[1] * float(size[0]) - 0.5
            texel = place_of(params.levels, int(wp.floor(y)), int(wp.floor(x)), m)
            place.at = locate(params, texel[1], texel[2], m, m == mip)
            place.mip = m
            place.x = x - wp.floor(x)
            place.y = y - wp.floor(y)
            m += 1
        return place

    return find


@cache
def make_page_sample(codes: Codes, ranges: tuple[tuple[float, float, bool], ...], tile: int) -> wp.Function:
    """`(params: PageParams, uv, lod) -> vec`: trilinear, as a neural texture's `sample`, from pages in memory. Without
    gradients."""
    vec, unpack, find = codes.vec, make_unpack(codes), make_find(tile)

    @wp.func
    def result(params: PageParams, at: int, j: int, mip: int) -> vec:
        return unpack(params.words, at)

    stored = make_stored(result, codes.channels, ranges, PageParams)

    @wp.func
    def sample(params: PageParams, uv: wp.vec2, lod: float) -> vec:
        last = params.levels.sizes.shape[0] - 1
        level = wp.clamp(lod, 0.0, float(last))
        total = vec()
        for k in range(2):
            between = level - wp.floor(level)
            share = wp.where(k == 0, 1.0 - between, between)
            if share > 0.0:
                place = find(params, uv, wp.min(int(level) + k, last))
                for n in range(4):
                    weight = wp.where(n % 2 == 0, 1.0 - place.x, place.x) * wp.where(n / 2 == 0, 1.0 - place.y, place.y)
                    weight *= share
                    if weight > 0.0:
                        total += weight * stored(params, place.at + n / 2 * (tile + 1) + n % 2, 0, 0)
        return total

    return sample


@cache
def make_page_texel(codes: Codes, ranges: tuple[tuple[float, float, bool], ...], tile: int) -> wp.Function:
    """`(params: PageParams, i, j, mip) -> vec`: as a neural texture's `texel`, from pages in memory."""
    vec, unpack, locate = codes.vec, make_unpack(codes), make_locate(tile)

    @wp.func
    def result(params: PageParams, i: int, j: int, mip: int) -> vec:
        place = place_of(params.levels, i, j, mip)
        size, m, at = params.levels.sizes[place[0]], int(place[0]), int(-1)
        while at < 0 and m < params.levels.sizes.shape[0]:
            coarser = params.levels.sizes[m]
            row, column = place[1] * coarser[0] / size[0], place[2] * coarser[1] / size[1]
            at = locate(params, row, column, m, m == place[0])
            m += 1
        return unpack(params.words, at)

    return make_stored(result, codes.channels, ranges, PageParams)


@cache
def make_tiles_kernel(codes: Codes, tile: int, texel: wp.Function, params_type: Any) -> wp.Kernel:
    """Decodes pages into slots. jobs [n, 4]: page, slot, the page that leaves this slot or -1, level.
    dim [n, tile + 1, tile + 1]"""
    pack = make_pack(codes)

    @wp.kernel(module="unique", enable_backward=False)
    def tiles_kernel(params: params_type, jobs: wp.array2d[int], pages: PageParams):
        n, i, j = wp.tid()
        page, slot, left, mip = jobs[n, 0], jobs[n, 1], jobs[n, 2], jobs[n, 3]
        number, columns = page - pages.first[mip], pages.columns[mip]
        row, column = number / columns * tile + i, number % columns * tile + j
        pack(texel(params, row, column, mip), pages.words, (slot * (tile + 1) + i) * (tile + 1) + j)
        if i + j == 0:
            pages.slots[page] = slot
            if left >= 0:
                pages.slots[left] = -1

    return tiles_kernel
