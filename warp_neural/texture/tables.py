"""Tables of the entropy coder, the same on every machine: made from correctly rounded exponentials by integers alone.

A table has 0xFFFF, then for each symbol the last of its values of 0 to 65535: of the nearest to the centre first, then
by turns above and below, last of all of the symbols that it does not have. 96 scales, eight to an octave from 1/64.
"""

from decimal import Decimal, localcontext
from functools import cache
from itertools import accumulate

import numpy as np

from warp_neural.kernels.texture.coding import AFTER, AFTER_ALL

SCALES = 96
PHASES = 5  # eighths of a step from a symbol to the centre, 0 to 4
LAPLACE, GAUSS = 0, 1


def scale_of(which: int) -> Decimal:
    """The middle of the scales of one table: 1/64 to 64 steps."""
    return Decimal(2 ** (which // 8) * (17 + 2 * (which % 8))) / 1024


def reach(which: int) -> int:
    """The largest symbol of a table and its smallest, negated."""
    return int(6 * scale_of(which)) + 2


@cache
def laplace_tables() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(all tables uint16, of each scale in turn those of its phases; int32 where each begins, and the end; int32 the
    last value of symbol 0 of each, then -1 for each)."""
    tables = [laplace(which, phase) for which in range(SCALES) for phase in range(PHASES)]
    zeros = np.full(2 * len(tables), -1, np.int32)
    zeros[: len(tables)] = [table[1] for table in tables]
    return *joined(tables), zeros


def joined(tables: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """One after the other, AFTER entries between, and where each begins, and the end."""
    after = np.full(AFTER, 0xFFFF)
    offsets = np.cumsum([0, *(len(table) + AFTER for table in tables)], dtype=np.int32)
    parts = [part for table in tables for part in (table, after)]
    return np.concatenate([*parts, np.full(AFTER_ALL, 0xFFFF)]).astype(np.uint16), offsets


@cache
def _tails(which: int) -> np.ndarray:
    """2^32 exp(-t / 8 b) of t = 0, 1, ..., rounded down after each product."""
    one = rounded_exponential(1, 8 * scale_of(which))
    return np.array(list(accumulate(range(8 * reach(which) + 8), lambda tail, _: tail * one >> 32, initial=1 << 32)))


@cache
def laplace(which: int, phase: int) -> np.ndarray:
    """Of the Laplace distribution around a centre `phase` eighths above symbol 0."""
    middles = 8 * in_order(reach(which)) - phase
    nearer, farther = (_tails(which)[np.abs(np.abs(middles) + step)] for step in (-4, 4))
    inside = np.abs(middles) < 4  # the centre is
    return _table(np.where(inside, (1 << 32) - (nearer + farther >> 1), nearer - farther >> 1), 1 << 32)


@cache
def gauss(which: int) -> np.ndarray:
    """Of the normal distribution around symbol 0, whose standard deviation is the scale."""
    variance = 2 * scale_of(which) ** 2
    masses = [rounded_exponential(symbol**2, variance) for symbol in range(reach(which) + 1)]
    masses = np.array(masses)[np.abs(in_order(reach(which)))]
    return _table(masses, int(masses.sum()))


def ones(share: int) -> np.ndarray:
    """Of 0 and 1; share: of ones, in 64ths, 1 to 63."""
    return _table(np.array([64 - share, share]), 64)


def in_order(reach: int) -> np.ndarray:
    """0, 1, -1, 2, -2, ..."""
    places = np.arange(2 * reach + 1)
    return (places + 1) // 2 * np.where(places % 2, 1, -1)


def _table(masses: np.ndarray, whole: int) -> np.ndarray:
    """At least 1 of 65536 for each symbol, 16 for all that the table does not have."""
    lasts = np.cumsum(1 + masses * (65520 - len(masses)) // whole) - 1
    return np.concatenate([[0xFFFF], lasts, [0xFFFF]])


def rounded_exponential(numerator: int, denominator: Decimal) -> int:
    """2^32 exp(-numerator / denominator) to the nearest whole number; `Decimal` rounds correctly, to 40 digits here."""
    with localcontext() as context:
        context.prec = 40
        return int(((-numerator / denominator).exp() * 2**32).to_integral_value())
