"""Latents in blocks that decode on their own: where they are, their streams, and the index of all."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.texture.sections import Reader, unsigned

MOST_LATENTS = 20_000  # in a byte: no symbol has more than 65,516 of 65,536, or less than 1 / 2,270 bits


@dataclass(frozen=True)
class Blocks:
    """Blocks of `block` x `block` texels, the cells of a grid that they have in whole cells of the coarsest grid."""

    spec: TextureSpec
    block: int

    def side(self, grid: int) -> int:
        """Cells."""
        return self.block // self.spec.grids[grid].scale

    def counts(self, mip: int, grid: int) -> tuple[int, int]:
        """(rows, columns) of blocks."""
        rows, columns = self.spec.cells(mip, grid)
        side = self.side(grid)
        return -(-rows // side), -(-columns // side)

    def place(self, mip: int, grid: int, block: int) -> tuple[int, int]:
        """First row and column of a block."""
        side, (row, column) = self.side(grid), divmod(block, self.counts(mip, grid)[1])
        return row * side, column * side

    def places(self, mip: int, grid: int) -> list[tuple[int, int]]:
        """Of each block."""
        rows, columns = self.counts(mip, grid)
        return [self.place(mip, grid, block) for block in range(rows * columns)]

    @property
    def order(self) -> list[tuple[int, int]]:
        """(mip, grid) in the order of the file: parents first."""
        return [(mip, grid) for mip in range(self.spec.mips) for grid in reversed(range(len(self.spec.grids)))]

    def touched(self, mip: int, grid: int, rows: range, columns: range) -> list[int]:
        """The blocks of these cells, which wrap, in order."""
        side, (down, right) = self.side(grid), self.counts(mip, grid)
        height, width = self.spec.cells(mip, grid)
        ys, xs = ({i % n // side for i in cells} for cells, n in ((rows, height), (columns, width)))
        return sorted(y * right + x for y in ys for x in xs if y < down)


@dataclass(frozen=True)
class Streams:
    """Where the streams of the blocks of one grid of one mip are: each 0 bytes if all latents are zero."""

    sizes: np.ndarray
    """bytes [blocks]"""
    starts: np.ndarray
    """in the file [blocks]"""
    checksums: np.ndarray


def pack_index(streams: Sequence[bytes]) -> bytes:
    """Length of each, and its CRC-32 if it is not empty."""
    entries = (
        unsigned(len(stream)) + (zlib.crc32(stream).to_bytes(4, "little") if stream else b"") for stream in streams
    )
    return b"".join(entries)


def unpack_index(reader: Reader, blocks: Blocks, start: int) -> dict[tuple[int, int], Streams]:
    """By mip and grid; start: of the first stream in the file."""
    counts = {place: int(np.prod(blocks.counts(*place))) for place in blocks.order}
    reader.require(sum(counts.values()) <= len(reader.data), "shorter than its blocks")
    index = {}
    for place, count in counts.items():
        sizes, checksums = np.zeros(count, np.int64), np.zeros(count, np.int64)
        for i in range(count):
            sizes[i] = reader.unsigned()
            if sizes[i]:
                checksums[i] = int.from_bytes(reader.bytes(4), "little")
        starts = start + np.cumsum(sizes) - sizes
        start += int(sizes.sum())
        index[place] = Streams(sizes, starts, checksums)
    reader.end()
    return index
