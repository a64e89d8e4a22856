"""Mips of a `.wntc` file, or a rectangle of one, back to latents: grids from coarse to fine, all mips together."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.errors import require_whole
from warp_neural.texture.blocks import MOST_LATENTS
from warp_neural.texture.coder import decode_grid, place
from warp_neural.texture.sections import REMEDY

if TYPE_CHECKING:
    from warp_neural.texture.file import TextureFile

Rectangle = tuple[int, int, int, int]
Cells = tuple[range, range]  # rows and columns, beyond the end where they wrap


@dataclass(frozen=True)
class _Grid:
    """A grid of some mips, on a device, without the channels that are zero everywhere."""

    shapes: list[tuple[int, int, int]]
    """rows, columns, channels of each mip"""
    starts: list[int]
    """the first cell of each, and the end"""
    latents: wp.array
    """int8 [cells, channels]"""
    names: list[tuple[int, int]]
    """mip and block of each stream"""
    damaged: wp.array | None
    """int32 [streams], not 0 where one is"""


def decode_mips(
    file: "TextureFile", mips: Sequence[int], rectangle: Rectangle | None, device: wp.DeviceLike
) -> list[tuple[np.ndarray, ...]]:
    """Of each, as `TextureFile.latents`."""
    for mip in mips:
        require_whole("mip", mip, 0, file.spec.mips - 1)
    device, count = find_device(device), len(file.spec.grids)
    wanted = [[_cells(file, mip, g, rectangle) for g in range(count)] for mip in mips]
    needed = [_needed_blocks(file, mip, each) for mip, each in zip(mips, wanted, strict=True)]
    grids: list[_Grid] = []
    for g in reversed(range(count)):
        streams = _streams(file, g, [(mip, block) for mip, each in zip(mips, needed, strict=True) for block in each[g]])
        grids.append(_decode(file, g, mips, streams, grids[-1] if grids else None, device))
    results = []
    for g, grid in zip(reversed(range(count)), grids, strict=True):
        if grid.damaged and grid.damaged.numpy().any():
            mip, block = grid.names[int(grid.damaged.numpy().argmax())]
            raise _refusal(file, mip, g, block)
        parts = np.split(grid.latents.numpy(), grid.starts[1:-1])
        parts = (part.reshape(shape) for part, shape in zip(parts, grid.shapes, strict=True))
        cells = (each[g] if rectangle else None for each in wanted)
        results.append([_all_channels(file, g, *pair) for pair in zip(parts, cells, strict=True)])
    return list(zip(*reversed(results), strict=True))


def _cells(file: "TextureFile", mip: int, grid: int, rectangle: Rectangle | None) -> Cells:
    rows, columns = file.spec.cells(mip, grid)
    if rectangle is None:
        return range(rows), range(columns)
    left, top, width, height = rectangle
    tall, wide = file.spec.size(mip)
    if not (0 <= top < top + height <= tall and 0 <= left < left + width <= wide):
        raise InputError(f"rectangle={rectangle}: mip {mip} is {wide} x {tall}; choose left, top, width, height inside")
    scale = file.spec.grids[grid].scale
    return tuple(range(at // scale, (at + n - 1) // scale + 2) for at, n in ((top, height), (left, width)))


def _needed_blocks(file: "TextureFile", mip: int, wanted: list[Cells]) -> list[list[int]]:
    """The blocks of the cells that are wanted, and those of their parents: a block reads those that it covers and one
    row and column beyond."""
    needed, blocks = [], file.blocks
    for g, cells in enumerate(wanted):
        touched = set(blocks.touched(mip, g, *cells))
        if g:
            ratio, side = file.spec.grids[g].scale // file.spec.grids[g - 1].scale, blocks.side(g - 1)
            rows, columns = file.spec.cells(mip, g)
            for y, x in (blocks.place(mip, g - 1, i) for i in needed[-1]):
                first, n = (y // ratio, x // ratio), side // ratio + 1
                covered = [range(at, min(at + n, most + 1)) for at, most in zip(first, (rows, columns), strict=True)]
                touched |= set(blocks.touched(mip, g, *covered))
        needed.append(sorted(touched))
    return needed


def _streams(file: "TextureFile", grid: int, blocks: list[tuple[int, int]]) -> dict[tuple[int, int], bytes]:
    """By mip and block, those that are not empty."""
    result, channels, side = {}, int(file.contexts[grid].channels.sum()), file.blocks.side(grid)
    for mip, block in blocks:
        streams, (rows, columns) = file.streams[mip, grid], file.spec.cells(mip, grid)
        size, start = int(streams.sizes[block]), int(streams.starts[block])
        if not size:
            continue
        row, column = file.blocks.place(mip, grid, block)
        most = min(rows - row, side) * min(columns - column, side) * channels
        stream = file.data[start : start + size]
        if zlib.crc32(stream) != streams.checksums[block] or not most or most > MOST_LATENTS * size:
            raise _refusal(file, mip, grid, block)
        result[mip, block] = stream
    return result


def _decode(
    file: "TextureFile",
    grid: int,
    mips: Sequence[int],
    streams: dict[tuple[int, int], bytes],
    above: _Grid | None,
    device: wp.Device,
) -> _Grid:
    channels, scales = int(file.contexts[grid].channels.sum()), [each.scale for each in file.spec.grids]
    shapes = [(*file.spec.cells(mip, grid), channels) for mip in mips]
    starts = np.cumsum([0, *(rows * columns for rows, columns, _ in shapes)]).tolist()
    above = above or _Grid(shapes, starts, _zeros((0, 0), device), [], None)
    blocks, at = [], 0
    for (mip, block), stream in streams.items():
        i, row_column = mips.index(mip), file.blocks.place(mip, grid, block)
        begin = starts[i], above.starts[i], at, len(stream)
        blocks.append(place(*row_column, shapes[i], above.shapes[i], *begin))
        at += len(stream)
    latents, damaged = _zeros((starts[-1], channels), device), None
    if blocks:
        data = wp.array(np.frombuffer(b"".join(streams.values()), np.uint8), device=device)
        ratio = scales[grid + 1] // scales[grid] if grid + 1 < len(scales) else 1
        context, side = file.contexts[grid].integers, file.blocks.side(grid)
        damaged = decode_grid(latents, above.latents, context, np.array(blocks, np.int32), data, side, ratio)
    return _Grid(shapes, starts, latents, list(streams), damaged)


def _zeros(shape: tuple, device: wp.Device) -> wp.array:
    """On the CPU they take memory when they are written only."""
    if device.is_cuda:
        return wp.zeros(shape, wp.int8, device)
    return wp.array(np.zeros(shape, np.int8), dtype=wp.int8, device=device, copy=False)


def _all_channels(file: "TextureFile", grid: int, latents: np.ndarray, cells: Cells | None) -> np.ndarray:
    """With those that are zero everywhere; of some cells only."""
    if cells:
        rows, columns = (np.array(each) % n for each, n in zip(cells, latents.shape, strict=False))
        latents = latents[rows[:, None], columns]
    used = file.contexts[grid].channels
    result = latents
    if not used.all():
        result = np.zeros((*latents.shape[:2], len(used)), np.int8)
        if used.any():
            result[..., used] = latents
    return 2 * result - 1 if file.spec.grids[grid].bits == 1 else result


def _refusal(file: "TextureFile", mip: int, grid: int, block: int) -> InputError:
    return InputError(f"{file.path}: mip {mip} grid {grid} block {block}: its content is not whole; {REMEDY}")
