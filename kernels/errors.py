"""The one exception for input that a user can mend, and the checks that raise it."""

from math import isfinite
from operator import index
from typing import Any

LARGEST = 2**31 - 1


class InputError(ValueError):
    """Bad input: one line that names the file, option or argument, what is wrong with it, and the remedy."""


def require(condition: bool, name: str, value: Any, expected: str) -> None:
    if not condition:
        text = repr(value)
        raise InputError(f"{name}={text if len(text) < 100 else type(value).__name__}: expected {expected}")


def require_whole(name: str, value: Any, low: int = 1, high: int = LARGEST) -> None:
    """A whole number from `low` to `high`."""
    try:
        inside = low <= index(value) <= high
    except TypeError:
        inside = False
    require(inside, name, value, f"a whole number of {low} to {high}" if high < LARGEST else f"a whole number >= {low}")


def is_finite(value: Any) -> bool:
    """Whether it is a number, neither NaN nor infinite."""
    try:
        return isfinite(value)
    except (TypeError, OverflowError):
        return False
