"""A texture in tiles of which some are in memory: a table of pages, and samples that say what they miss.

Virtual texturing with feedback: Barrett, "Sparse Virtual Textures", GDC 2008; Mittring, "Advanced Virtual Texture
Topics", SIGGRAPH 2008 courses. A page is a tile of a level; pages are numbered from the coarsest level to the finest,
by rows. One that is in memory has a slot, see `Tiles`.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.texture.levels import Levels, place_of
from warp_neural.kernels.texture.texel import Ranges, make_stored
from warp_neural.kernels.texture.tiles import Tiles, make_read


@wp.struct
class PageParams:
    """first [mips]: the number of each level's first page; columns [mips]: pages a row. slots [pages]: where each is,
    -1 if nowhere; the coarsest level is always somewhere. wanted [pages]: 1 for those that were asked for, or read in
    place of these. words: of all slots, as `Tiles` has them."""

    levels: Levels
    first: wp.array[int]
    columns: wp.array[int]
    slots: wp.array[int]
    wanted: wp.array[int]
    words: wp.array2d[wp.uint32]


@wp.struct
class Place:
    """Row i, column j of a slot, of level `mip`, is the upper left of four texels. x, y: from it to the point."""

    slot: int
    i: int
    j: int
    mip: int
    x: float
    y: float


@wp.func
def slot_of(params: PageParams, page: int, asked: bool) -> int:
    """-1 if it is nowhere. asked: not in place of a finer one."""
    slot = params.slots[page]
    if (asked or slot >= 0) and params.wanted[page] == 0:
        params.wanted[page] = 1  # all write the same
    return slot


@cache
def make_find(tile: int) -> wp.Function:
    """`(params, uv, mip) -> Place`: in that level, or, if the page is in no slot, in the finest coarser one that is."""

    @wp.func
    def find(params: PageParams, uv: wp.vec2, mip: int) -> Place:
        place, m = Place(), int(mip)
        place.slot = -1
        while place.slot < 0 and m < params.levels.sizes.shape[0]:
            size = params.levels.sizes[m]
            x, y = uv[0] * float(size[1]) - 0.5, uv[1] * float(size[0]) - 0.5
            texel = place_of(params.levels, int(wp.floor(y)), int(wp.floor(x)), m)
            page = params.first[m] + texel[1] / tile * params.columns[m] + texel[2] / tile
            place.slot = slot_of(params, page, m == mip)
            place.i = texel[1] % tile
            place.j = texel[2] % tile
            place.mip = m
            place.x = x - wp.floor(x)
            place.y = y - wp.floor(y)
            m += 1
        return place

    return find


@cache
def make_page_sample(tiles: Tiles, ranges: Ranges) -> wp.Function:
    """`(params: PageParams, uv, lod) -> vec`: trilinear, as a neural texture's `sample`, from pages in memory. Without
    gradients."""
    vec, read, find = tiles.codes.vec, make_read(tiles), make_find(tiles.tile)

    @wp.func
    def result(params: PageParams, i: int, j: int, slot: int) -> vec:
        return read(params.words, slot, i, j)

    stored = make_stored(result, ranges, PageParams)

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
                        total += weight * stored(params, place.i + n / 2, place.j + n % 2, place.slot)
        return total

    return sample


@cache
def make_page_texel(tiles: Tiles, ranges: Ranges) -> wp.Function:
    """`(params: PageParams, i, j, mip) -> vec`: as a neural texture's `texel`, from pages in memory."""
    vec, read, tile = tiles.codes.vec, make_read(tiles), tiles.tile

    @wp.func
    def result(params: PageParams, i: int, j: int, mip: int) -> vec:
        place = place_of(params.levels, i, j, mip)
        size, m, slot, row, column = params.levels.sizes[place[0]], int(place[0]), int(-1), int(0), int(0)
        while slot < 0 and m < params.levels.sizes.shape[0]:
            coarser = params.levels.sizes[m]
            row, column = place[1] * coarser[0] / size[0], place[2] * coarser[1] / size[1]
            page = params.first[m] + row / tile * params.columns[m] + column / tile
            slot = slot_of(params, page, m == place[0])
            m += 1
        return read(params.words, slot, row % tile, column % tile)

    return make_stored(result, ranges, PageParams)


@wp.kernel(enable_backward=False)
def update_slots_kernel(changes: wp.array2d[int], slots: wp.array[int]):
    """changes [n, 3]: a page that comes in, its slot, and the page that leaves this slot or -1. dim n"""
    n = wp.tid()
    slots[changes[n, 0]] = changes[n, 1]
    if changes[n, 2] >= 0:
        slots[changes[n, 2]] = -1
