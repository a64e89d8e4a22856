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
    inputs = [wp.array(each, device="cpu") for each in (latents, parents, context)] + _tables("cpu")
    notes, space = wp.empty(most, wp.uint32, "cpu"), wp.empty(3 * most + 4, wp.uint8, "cpu")
    size, streams = wp.empty(1, int, "cpu"), []
    inputs.append(wp.empty((1, space_words(side)), int, "cpu"))
    for row, column in blocks:
        if not latents[row : row + side, column : column + side].any():
            streams.append(b"")
            continue
        place = [space, notes, row, column, side, _ratio(latents, parents), *inputs, size]
        wp.launch(encode_block_kernel(), 1, place, device="cpu")
        streams.append(space.numpy()[len(space) - int(size.numpy()[0]) :].tobytes())
    return streams


def decode_grid(
    latents: wp.array, parents: wp.array, context: np.ndarray, blocks: np.ndarray, data: wp.array, side: int
) -> np.ndarray:
    """Decode blocks into `latents`, zeros as `encode_grid` has them, on their device; where a stream is damaged, bool.

    blocks: int32 [., 4], the first row and column of each, the first byte and the bytes of its stream in data.
    """
    device = latents.device
    damaged = wp.zeros(len(blocks), int, device)
    lanes = 32 if device.is_cuda else 1
    place = [data, wp.array(blocks, dtype=int, device=device), side, _ratio(latents, parents), latents, parents]
    place += [wp.array(context, device=device), *_tables(device.alias)]
    place += [wp.empty((len(blocks), space_words(side)), int, device), lanes, damaged]
    wp.launch(decode_blocks_kernel(), lanes * len(blocks), place, device=device, block_dim=32, record_tape=False)
    return damaged.numpy() != 0


@cache
def _tables(device: str) -> list[wp.array]:
    return [wp.array(each, device=device) for each in laplace_tables()]


def _ratio(latents: np.ndarray | wp.array, parents: np.ndarray | wp.array) -> int:
    return latents.shape[0] // parents.shape[0]


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
