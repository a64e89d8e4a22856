"""The entropy coder on a device: blocks of latents, and lists of numbers, to bytes and back."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import warp as wp

from warp_neural.kernels.texture.coding import decode_blocks_kernel, encode_block_kernel, numbers_kernels, space_words
from warp_neural.texture.tables import laplace_tables


def encode_grid(
    latents: np.ndarray, parents: np.ndarray, context: np.ndarray, blocks: Sequence[tuple[int, int]], side: int
) -> list[bytes]:
    """The stream of each block (its first row and column) of one grid of one mip, on the CPU; none if all are zero.

    latents, parents: int8 [rows, columns, channels], without the channels that are zero everywhere. context: as
    `Context.integers` has it.
    """
    rows, columns, channels = latents.shape
    most = 2 * min(side, rows) * min(side, columns) * channels
    places = np.array([place(*block, latents.shape, parents.shape) for block in blocks], np.int32)
    flat = [each.reshape(each.shape[0] * each.shape[1], each.shape[2]) for each in (latents, parents)]
    places, *inputs = (wp.array(each, device="cpu") for each in (places, *flat, context))
    inputs += _tables("cpu")
    notes, space = wp.empty(most, wp.uint32, "cpu"), wp.empty(3 * most + 4, wp.uint8, "cpu")
    size, streams = wp.empty(1, int, "cpu"), []
    inputs.append(wp.empty((1, space_words(side)), int, "cpu"))
    for i, (row, column) in enumerate(blocks):
        if not latents[row : row + side, column : column + side].any():
            streams.append(b"")
            continue
        arguments = [space, notes, places, i, side, rows // parents.shape[0], *inputs, size]
        wp.launch(encode_block_kernel(), 1, arguments, device="cpu")
        streams.append(space.numpy()[len(space) - int(size.numpy()[0]) :].tobytes())
    return streams


def place(
    row: int, column: int, shape: tuple, parents: tuple, cell: int = 0, parent: int = 0, first: int = 0, size: int = 0
) -> tuple[int, ...]:
    """A block's row in the kernels' `blocks`. shape, parents: of the latents of its mip, and of the next coarser grid.
    cell, parent: where these begin; first, size: the bytes of its stream."""
    return row, column, *shape[:2], *parents[:2], cell, parent, first, size


def decode_grid(
    latents: wp.array, parents: wp.array, context: np.ndarray, blocks: np.ndarray, data: wp.array, side: int, ratio: int
) -> wp.array:
    """Decode blocks into `latents`, zeros, on their device; not 0 where a stream is damaged, int32 [blocks].

    latents, parents: int8 [cells of some mips, channels], without the channels that are zero everywhere. context: as
    `Context.integers` has it. blocks: a `place` of each. ratio: of a cell of the parents to one of the latents.
    """
    device = latents.device
    damaged, lanes = wp.zeros(len(blocks), int, device), 32 if device.is_cuda else 1
    arguments = [data, wp.array(blocks, dtype=int, device=device), side, ratio, latents, parents]
    arguments += [wp.array(context, device=device), *_tables(device.alias)]
    arguments += [wp.empty((len(blocks), space_words(side)), int, device), lanes, damaged]
    wp.launch(decode_blocks_kernel(), lanes * len(blocks), arguments, device=device, block_dim=32, record_tape=False)
    return damaged


@cache
def _tables(device: str) -> list[wp.array]:
    return [wp.array(each, device=device) for each in laplace_tables()]


def encode_numbers(numbers: np.ndarray, which: np.ndarray, tables: tuple[np.ndarray, np.ndarray]) -> bytes:
    """The stream of numbers of -32768 to 32767, int32 [n], number i by table which[i]."""
    n, size = len(numbers), wp.empty(1, int, "cpu")
    inputs = [wp.array(each, device="cpu") for each in (numbers, which, *tables)]
    space, notes = wp.empty(6 * n + 4, wp.uint8, "cpu"), wp.empty(2 * n, wp.uint32, "cpu")
    wp.launch(numbers_kernels()[1], 1, [space, notes, *inputs, size], device="cpu")
    return space.numpy()[len(space) - int(size.numpy()[0]) :].tobytes()


def decode_numbers(stream: bytes, which: np.ndarray, tables: tuple[np.ndarray, np.ndarray]) -> np.ndarray | None:
    """int32 [n]; None where the stream is damaged."""
    numbers, damaged = wp.zeros(len(which), int, "cpu"), wp.empty(1, int, "cpu")
    inputs = [wp.array(np.frombuffer(stream, np.uint8), device="cpu"), numbers]
    inputs += [wp.array(each, device="cpu") for each in (which, *tables)]
    wp.launch(numbers_kernels()[0], 1, [*inputs, damaged], device="cpu")
    return None if damaged.numpy()[0] else numbers.numpy()
