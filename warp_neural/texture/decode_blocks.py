"""A mip of a `.wntc` file, or a rectangle of it, back to latents: grids from coarse to fine."""

import zlib
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.errors import require_whole
from warp_neural.texture.blocks import MOST_LATENTS
from warp_neural.texture.coder import decode_grid
from warp_neural.texture.sections import REMEDY

if TYPE_CHECKING:
    from warp_neural.texture.file import TextureFile

Rectangle = tuple[int, int, int, int]
Cells = tuple[range, range]  # rows and columns, beyond the end where they wrap


def decode_mip(
    file: "TextureFile", mip: int, rectangle: Rectangle | None, device: wp.DeviceLike
) -> tuple[np.ndarray, ...]:
    """As `TextureFile.latents`."""
    require_whole("mip", mip, 0, file.spec.mips - 1)
    device, spec = find_device(device), file.spec
    wanted = [_cells(file, mip, g, rectangle) for g in range(len(spec.grids))]
    needed = _needed_blocks(file, mip, wanted)
    result, parents = [], None
    for g in reversed(range(len(spec.grids))):
        live = int(file.contexts[g].channels.sum())
        shape = *spec.cells(mip, g), live
        parents = _empty((*shape[:2], 0), device) if parents is None else parents
        latents = _decode(file, mip, g, needed[g], parents, shape, device)
        result.append(_all_channels(file, g, latents.numpy(), wanted[g] if rectangle else None))
        parents = latents
    return tuple(reversed(result))


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
            places = blocks.places(mip, g - 1)
            for y, x in (places[i] for i in needed[-1]):
                first, n = (y // ratio, x // ratio), side // ratio + 1
                covered = [range(at, min(at + n, most + 1)) for at, most in zip(first, (rows, columns), strict=True)]
                touched |= set(blocks.touched(mip, g, *covered))
        needed.append(sorted(touched))
    return needed


def _decode(
    file: "TextureFile", mip: int, grid: int, needed: list[int], parents: wp.array, shape: tuple, device: wp.Device
) -> wp.array:
    """Without the channels that are zero everywhere."""
    streams, side = file.streams[mip, grid], file.blocks.side(grid)
    places = file.blocks.places(mip, grid)
    table, data, at = [], [], 0
    for i in needed:
        size, start = int(streams.sizes[i]), int(streams.starts[i])
        if not size:
            continue
        row, column = places[i]
        cells = (min(row + side, shape[0]) - row) * (min(column + side, shape[1]) - column)
        stream = file.data[start : start + size]
        if zlib.crc32(stream) != streams.checksums[i] or cells * shape[2] > MOST_LATENTS * size:
            raise _refusal(file, mip, grid, i)
        table.append((i, row, column, at, size))
        data.append(stream)
        at += size
    latents = _empty(shape, device)
    if table and shape[2]:
        bytes = wp.array(np.frombuffer(b"".join(data), np.uint8), device=device)
        blocks = np.array(table, np.int32)
        damaged = decode_grid(latents, parents, file.contexts[grid].integers, blocks[:, 1:], bytes, side)
        if damaged.any():
            raise _refusal(file, mip, grid, int(blocks[damaged.argmax(), 0]))
    elif table:
        raise _refusal(file, mip, grid, table[0][0])
    return latents


def _empty(shape: tuple, device: wp.Device) -> wp.array:
    """Zeros, which on the CPU take memory when they are written only."""
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
