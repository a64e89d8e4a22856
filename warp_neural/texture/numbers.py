"""Arrays of whole numbers in few bytes: each by the better of a Laplace or a normal distribution of one of 96 scales.

Before the stream, of each array: the table, one byte (0 to 95 Laplace, 96 to 191 normal, 192 to 254: 0 and 1 with 1 to
63 ones in 64; 255: all are the middle), and the middle as a zigzag number.
"""

from collections.abc import Sequence
from functools import cache
from math import prod

import numpy as np

from warp_neural.errors import InputError
from warp_neural.texture.coder import decode_numbers, encode_numbers
from warp_neural.texture.sections import Reader, unsigned
from warp_neural.texture.tables import SCALES, gauss, joined, laplace, ones

SAME = 255
LARGEST = 2**14 - 1  # of a number, and of a middle


def pack(arrays: Sequence[np.ndarray]) -> bytes:
    """Raises `InputError` for numbers beyond +-`LARGEST`."""
    head, tables, which, numbers = b"", [], [], []
    for array in arrays:
        flat = array.ravel().astype(np.int64)
        if flat.size and np.abs(flat).max() > LARGEST:
            raise InputError(f"numbers up to {np.abs(flat).max()} steps; the file has them up to {LARGEST}")
        bits = flat.size > 0 and flat.min() == 0 and flat.max() == 1
        middle = int(np.median(flat)) if flat.size and not bits else 0
        table = _best(flat - middle)
        head += bytes([table]) + unsigned(2 * middle if middle >= 0 else -2 * middle - 1)
        if table != SAME:
            which += [len(tables)] * flat.size
            numbers += (flat - middle).tolist()
            tables.append(_table(table))
    stream = encode_numbers(np.array(numbers, np.int32), np.array(which, np.int32), joined(tables)) if tables else b""
    return head + stream


def unpack(reader: Reader, shapes: Sequence[tuple[int, ...]]) -> list[np.ndarray]:
    """int32 of these shapes, from the rest of the section."""
    tables, which, places = [], [], []
    for shape in shapes:
        table, code = reader.byte(), reader.unsigned()
        middle = -(code + 1) // 2 if code % 2 else code // 2
        reader.require(abs(middle) <= LARGEST, "numbers out of range")
        places.append((middle, prod(shape) if table != SAME else 0))
        if places[-1][1]:
            which += [len(tables)] * places[-1][1]
            tables.append(_table(table))
    stream = reader.rest()
    numbers = decode_numbers(stream, np.array(which, np.int32), joined(tables)) if tables else np.zeros(0, np.int32)
    reader.require(numbers is not None and (bool(tables) or not stream), "its numbers do not end where they must")
    parts = np.split(numbers, np.cumsum([count for _, count in places])[:-1])
    pairs = zip(shapes, places, parts, strict=True)
    return [
        np.full(shape, middle, np.int32) if not count else part.reshape(shape) + middle
        for shape, (middle, count), part in pairs
    ]


def _table(which: int) -> np.ndarray:
    if which < SCALES:
        return laplace(which, 0)
    return gauss(which - SCALES) if which < 2 * SCALES else ones(which - 2 * SCALES + 1)


def _best(flat: np.ndarray) -> int:
    """The table of fewest bits, of those near the mean magnitude and the standard deviation."""
    if not flat.any():
        return SAME
    values, counts = np.unique(flat, return_counts=True)
    if values.tolist() == [0, 1]:
        return 2 * SCALES - 1 + min(max(round(64 * float(flat.mean())), 1), 63)
    scales = np.abs(flat).mean(), np.sqrt((flat * flat).mean())
    around = [int(np.clip(8 * np.log2(64 * scale), 0, SCALES - 1)) for scale in scales]
    candidates = {
        first + min(max(near + step, 0), SCALES - 1)
        for first, near in ((0, around[0]), (SCALES, around[1]))
        for step in range(-3, 4)
    }
    return min(sorted(candidates), key=lambda table: _bits(table, values, counts))


def _bits(table: int, values: np.ndarray, counts: np.ndarray) -> float:
    costs = _costs(table)
    places = np.where(values > 0, 2 * values, 1 - 2 * values) - 1
    return float((costs[np.minimum(places, len(costs) - 1)] * counts).sum())


@cache
def _costs(table: int) -> np.ndarray:
    """Bits of its symbols in their order, and of each that it does not have."""
    costs = 16 - np.log2(np.diff(_table(table)[1:], prepend=-1))
    costs[-1] += 16
    return costs
