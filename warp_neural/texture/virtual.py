"""A neural texture decoded on feedback: only those tiles that the last picture wanted, in a cache of bounded size."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.errors import require, require_whole
from warp_neural.kernels.texture import filters
from warp_neural.kernels.texture.filtering import make_sampler
from warp_neural.kernels.texture.pages import PageParams, make_page_sample, make_page_texel, update_slots_kernel
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.texture.tiles import Tiles, make_decode_tiles_kernel, make_encode_tiles_kernel
from warp_neural.texture.decoder import BLOCK
from warp_neural.texture.levels import make_levels
from warp_neural.texture.memory import bytes_of
from warp_neural.texture.texture import Texture
from warp_neural.texture.tile_cache import Changes, TileCache

AT_ONCE = 256  # tiles that are decoded in one launch, which bounds the memory of those that become blocks


@dataclass(frozen=True)
class Update:
    """Pages that the samples since the last update wanted, coarser ones that stood in for these included; those of them
    that were not there (misses); decoded now; that left for these (evictions). Misses that were not decoded are wanted
    again by the next picture."""

    wanted: int
    misses: int
    decodes: int
    evictions: int


class VirtualTexture:
    """In kernels that take `params: virtual.Params`, launched with `virtual.params`, any thread calls
    `virtual.sample`, `virtual.texel` or what `virtual.make_sampler` makes, in place of the texture's own; after each
    picture `virtual.update()` decodes what it wanted and lacked.

    Where a tile is not there yet, samples read the finest coarser level that is; levels of one tile, or else the
    coarsest one, are always there. Once all that a picture wants fits and is there, samples are those of `CodedMaps`.

    budget: bytes of tiles and tables; the texture itself comes on top. tile: texels a side, 8 to 256, a multiple of 4.
    bits: of a channel, 8, 16, or 4 for BC4 blocks, which have losses. Raises `InputError` if the budget has no place
    for the tiles that are always there and one more.
    """

    Params = PageParams

    def __init__(self, texture: Texture, budget: int, tile: int = 64, bits: int = 8):
        require(bits in (4, 8, 16), "bits", bits, "4, 8 or 16")
        require_whole("tile", tile, 8, 256)
        require(tile % 4 == 0, "tile", tile, "a multiple of 4")
        self.texture, self.tiles = texture, Tiles(texture.state.spec.channels, bits, tile)
        spec, device = texture.state.spec, texture.device
        counts = page_counts(spec, tile)  # [mips, 2]
        sizes = counts.prod(axis=1)
        self.first = np.cumsum(sizes[::-1])[::-1] - sizes  # the coarsest level first
        pages, kept = int(sizes.sum()), int(sizes[sizes == 1].sum() or sizes[-1])
        params = self.params = PageParams()
        params.levels = make_levels(spec, device)
        params.first = wp.array(self.first, dtype=int, device=device)
        params.columns = wp.array(counts[:, 1], dtype=int, device=device)
        params.slots = wp.full(pages, -1, dtype=int, device=device)
        params.wanted = wp.zeros(pages, dtype=int, device=device)
        rows, words = self.tiles.shape
        tables, each, least = bytes_of(params), rows * words * 4, min(kept + 1, pages)
        slots = min((budget - tables) // each, pages)
        self.least = least * each + tables
        """bytes of the smallest cache"""
        if slots < least:
            raise InputError(f"budget={budget}: {least} tiles, the least, take {self.least} bytes; give those")
        params.words = wp.zeros((slots * rows, words), dtype=wp.uint32, device=device)
        self.cache = TileCache(pages, slots, kept)
        self._decode(Changes(np.arange(kept), np.arange(kept), np.full(kept, -1), 0))

    @property
    def bytes(self) -> int:
        """Of tiles and tables on the device, at most the budget."""
        return bytes_of(self.params)

    @property
    def used_bytes(self) -> int:
        """Of tables, and of the tiles that hold something."""
        unused, slots = int((self.cache.page_of < 0).sum()), len(self.cache.page_of)
        return self.bytes - unused * self.params.words.size * 4 // slots

    @cached_property
    def sample(self) -> wp.Function:
        return make_page_sample(self.tiles, self.texture.ranges)

    @cached_property
    def texel(self) -> wp.Function:
        return make_page_texel(self.tiles, self.texture.ranges)

    def make_sampler(self, filter: wp.Function = filters.bilinear) -> wp.Function:
        return make_sampler(self.texel, filter, self.texture.state.spec, self.Params)

    def update(self, decodes: int | None = None) -> Update:
        """Decode what was wanted since the last update and is not there, coarse levels first, `decodes` tiles at most.
        Where not all fits, the coarsest stay. Waits for the device."""
        wanted = np.flatnonzero(self.params.wanted.numpy())
        self.params.wanted.zero_()
        changes = self.cache.want(wanted, decodes)
        self._decode(changes)
        return Update(len(wanted), changes.misses, len(changes.pages), int((changes.left >= 0).sum()))

    def _decode(self, changes: Changes) -> None:
        for first in range(0, len(changes.pages), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            self._decode_some(changes.pages[some], changes.slots[some])
        if len(changes.pages):
            rows = np.stack([changes.pages, changes.slots, changes.left], axis=1)
            self._launch(update_slots_kernel, len(rows), self._put(rows), self.params.slots)

    def _decode_some(self, pages: np.ndarray, slots: np.ndarray) -> None:
        tiles, texture, side, count = self.tiles, self.texture, self.tiles.side, len(pages)
        mips = mip_of(self.first, pages)
        columns = page_counts(texture.state.spec, tiles.tile)[mips, 1]
        rows, columns = np.divmod(pages - self.first[mips], columns)
        kernel = make_decode_tiles_kernel(tiles, texture.decoder.texel, texture.Params)
        blocks = tiles.bits == 4
        places = np.arange(count) if blocks else slots
        jobs = self._put(np.stack([mips, rows * tiles.tile, columns * tiles.tile, places], axis=1))
        words = self.params.words
        if blocks:
            words = wp.empty((count * side**2, tiles.codes.words), dtype=wp.uint32, device=texture.device)
        self._launch(kernel, (count, side, side), texture.params, jobs, words)
        if blocks:
            dim = count, side // 4, side // 4, tiles.channels
            self._launch(make_encode_tiles_kernel(tiles), dim, words, self._put(slots), self.params.words)

    def _put(self, numbers: np.ndarray) -> wp.array:
        return wp.array(numbers, dtype=int, device=self.texture.device)

    def _launch(self, kernel: wp.Kernel, dim: int | tuple[int, ...], *inputs: Any) -> None:
        wp.launch(kernel, dim, inputs, device=self.texture.device, block_dim=BLOCK, record_tape=False)


def page_counts(spec: TextureSpec, tile: int) -> np.ndarray:
    """Rows and columns of pages of each level. [mips, 2]"""
    return np.array([[-(-side // tile) for side in spec.size(mip)] for mip in range(spec.mips)])


def mip_of(first: np.ndarray, pages: np.ndarray) -> np.ndarray:
    """The level of each page. first: of each level its first page, those of coarser levels before those of finer."""
    return len(first) - np.searchsorted(first[::-1], pages, side="right")
