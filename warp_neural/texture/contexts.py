"""What the coder of a grid's latents expects of each from those before it, in integers; docs/wntc.md.

Each number is a level, written as such: +-0, 1, 2, 3, then four to an octave: +-(4 + level % 4) << (level // 4 - 1), in
units of 2^-12.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np

from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.texture import numbers
from warp_neural.texture.sections import Reader, unsigned

UNIT = 4096
NEAR = ((0, -1), (-1, 0), (-1, -1), (-1, 1), (0, -2), (-2, 0))  # rows and columns from a latent to its neighbours
LARGEST = 68, 68, 55, 55, 55, 55, 55  # levels of each array: no sum of a context leaves 32 bits
SIGNED = 1, 3, 5  # arrays of means; scales are positive


@dataclass(frozen=True)
class Context:
    """Levels, int32, of a grid of n channels with p channels of its parents, none of them zero everywhere.

    scale = scale_0 + scale_near |neighbours| + scale_of |channels before| + scale_parent |four parents|; mean likewise,
    of signed latents, without parents.
    """

    channels: np.ndarray
    """bool [channels of the grid]: which are not zero everywhere"""
    arrays: tuple[np.ndarray, ...]
    """in the order of `shapes`"""

    @cached_property
    def integers(self) -> np.ndarray:
        """What the coder reads, int32 [.]: rows of n values and zeros to a multiple of 8; channels before as matrices
        [n, n]."""
        n, whole = int(self.channels.sum()), list(map(value, self.arrays))
        for i in (4, 5):
            square = np.zeros((n, n), np.int32)
            square[np.triu_indices(n, 1)] = whole[i]
            whole[i] = square
        rows = np.concatenate([np.reshape(array, (-1, n)) for array in whole]) if n else np.zeros((0, 0), np.int32)
        return np.pad(rows, ((0, 0), (0, -n % 8))).ravel()


def shapes(n: int, p: int) -> tuple[tuple[int, ...], ...]:
    """scale_0, mean_0, scale_near, mean_near, scale_of, mean_of of each channel and each later one, scale_parent."""
    pairs = (n * (n - 1) // 2,)
    return (n,), (n,), (6, n), (6, n), pairs, pairs, (p, n)


def value(levels: np.ndarray) -> np.ndarray:
    """int32, in units of 2^-12."""
    size = np.abs(levels)
    sizes = np.where(size < 4, size, (4 + size % 4) << np.maximum(size // 4 - 1, 0))
    return (np.sign(levels) * sizes).astype(np.int32)


def nearest_level(x: np.ndarray, largest: int) -> np.ndarray:
    """Of real numbers."""
    values = value(np.arange(largest + 1))
    between = (values[1:] + values[:-1]) / 2
    return (np.sign(x) * np.searchsorted(between, np.abs(x) * UNIT)).astype(np.int32)


def pack(contexts: Sequence[Context]) -> bytes:
    """Of every grid: a bit for each channel, the lowest first; which numbers are not zero; these."""
    masks = [np.packbits(context.channels, bitorder="little").tobytes() for context in contexts]
    arrays = [array for context in contexts for array in context.arrays]
    which = numbers.pack([array != 0 for array in arrays])
    return b"".join(masks) + unsigned(len(which)) + which + numbers.pack([array[array != 0] for array in arrays])


def unpack(reader: Reader, spec: TextureSpec) -> list[Context]:
    masks = []
    for grid in spec.grids:
        bits = np.unpackbits(np.frombuffer(reader.bytes(-(-grid.channels // 8)), np.uint8), bitorder="little")
        reader.require(not bits[grid.channels :].any(), "a channel that its grid does not have")
        masks.append(bits[: grid.channels].astype(bool))
    counts = [int(mask.sum()) for mask in masks]
    each_shapes = [shapes(*pair) for pair in zip(counts, [*counts[1:], 0], strict=True)]
    inside = Reader(reader.path, reader.part, reader.bytes(reader.unsigned()))
    which = [array != 0 for array in numbers.unpack(inside, [shape for each in each_shapes for shape in each])]
    arrays = iter(map(_placed, which, numbers.unpack(reader, [(int(each.sum()),) for each in which])))
    contexts = [Context(mask, tuple(islice(arrays, len(each)))) for mask, each in zip(masks, each_shapes, strict=True)]
    reader.require(all(map(_is_whole, contexts)), "numbers out of range")
    return contexts


def _placed(which: np.ndarray, levels: np.ndarray) -> np.ndarray:
    result = np.zeros(which.shape, np.int32)
    result[which] = levels
    return result


def _is_whole(context: Context) -> bool:
    limits = [(-largest * (i in SIGNED), largest) for i, largest in enumerate(LARGEST)]
    pairs = [(array, *limit) for array, limit in zip(context.arrays, limits, strict=True) if array.size]
    return all(low <= array.min() and array.max() <= high for array, low, high in pairs)
