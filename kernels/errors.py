"""The one exception for input that a user can mend, and the checks that raise it."""

from ctypes import c_float
from math import isfinite, nan
from operator import index
from typing import Any

LARGEST = 2**31 - 1  # of an index, a count or a coordinate on a device: 32 bits with a sign
LARGEST_SEED = 2**64 - 1


class InputError(ValueError):
    """Bad input: one line that names the file, option or argument, what is wrong with it, and the remedy."""


def require(condition: bool, name: str, value: Any, expected: str) -> None:
    if not condition:
        text = repr(value)
        raise InputError(f"{name}={text if len(text) < 100 else type(value).__name__}: expected {expected}")


def require_whole(name: str, value: Any, low: int = 1, high: int = LARGEST) -> None:
    """A whole number from `low` to `high`."""
    try:
        number = index(value)
    except TypeError:
        number = None
    bounds = f"a whole number >= {low}" if high == LARGEST and (number or 0) <= high else f"{low} to {high}"
    inside = number is not None and low <= number <= high
    require(inside, name, value, bounds if ">=" in bounds else f"a whole number of {bounds}")


def single(value: Any) -> float:
    """A number as float32 has it: infinite where it is too large, NaN where it is none."""
    try:
        return c_float(value).value
    except TypeError:
        return nan
    except OverflowError:
        return float("inf")


def is_finite(value: Any) -> bool:
    """Whether it is a number, neither NaN nor infinite, as float32 too."""
    return isfinite(single(value))
