"""The intermediate form of exported functions: a few kinds of statements, which each language writes its own way.

Expressions are text that all languages share: float literals end in f and unsigned ones in u; types are float, int,
uint and bool, also as conversions; there is no ?:, but `pick(condition, a, b)` of floats. Functions are `multiply_add`
(rounded once where hardware does), `exp`, `log`, `tanh_of`, `erf`, `sin`, `cos`, `sqrt`, `abs`, `floor`, `min`, `max`,
`nearest` (whole numbers, ties to even), `to_half` (rounded to float16), `quartic` (see `OneBlob`). `weights[i]` reads
the parameters, `x[i]` the inputs, and `y[i]` is a result.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Let:
    """A new constant."""

    name: str
    type: str
    value: str


@dataclass(frozen=True)
class Variable:
    name: str
    type: str
    value: str


@dataclass(frozen=True)
class Array:
    """Of `size` floats, not set yet."""

    name: str
    size: int


@dataclass(frozen=True)
class Set:
    target: str
    value: str


@dataclass(frozen=True)
class For:
    """`name` from 0 to count - 1; no two loops of a function share a name."""

    name: str
    count: int
    body: tuple["Statement", ...]


@dataclass(frozen=True)
class Block:
    """A scope of its own. note: a comment."""

    note: str
    body: tuple["Statement", ...]


@dataclass(frozen=True, eq=False)
class Layer:
    """`target[o]` = result, of `z`: biases[o] plus the sum of weights[o, k] * source[k] over k. The numbers are in the
    text, for languages that unroll it; they keep vectors between layers as they like, but read the `first` one from an
    array and write the `last` one to one."""

    source: str
    target: str
    weights: np.ndarray  # [n_out, n_in]
    biases: np.ndarray  # [n_out]
    result: str
    first: bool
    last: bool


Statement = Let | Variable | Array | Set | For | Block | Layer


@dataclass(frozen=True)
class Function:
    """Of floats, with a float result."""

    name: str
    arguments: tuple[str, ...]
    body: tuple[Statement, ...]
    result: str


def number(value: float) -> str:
    """A float literal, of a float32 number."""
    text = str(np.float32(value))
    return f"{text}f" if "e" in text or "." in text else f"{text}.0f"


def without_ternaries(expression: str) -> str:
    """C's `c ? a : b`, in parentheses or as a whole, as `pick(c, a, b)`."""
    start = expression.find("?")
    if start < 0:
        return expression
    left = _end(expression, start, -1)
    right = _end(expression, start, 1)
    colon = _colon(expression, start + 1, right)
    parts = expression[left:start], expression[start + 1 : colon], expression[colon + 1 : right]
    c, a, b = (without_ternaries(part.strip()) for part in parts)
    return f"{expression[:left]}pick({c}, {a}, {b}){without_ternaries(expression[right:])}"


def _end(text: str, at: int, step: int) -> int:
    """Of the innermost parentheses around `at`, or of the text."""
    depth, opening = 0, "()"[step < 0]
    while 0 <= at < len(text):
        if text[at] in "()":
            depth += 1 if text[at] == opening else -1
            if depth < 0:
                break
        at += step
    return at + (step < 0)


def _colon(text: str, at: int, end: int) -> int:
    """Of the ternary whose question mark is just before `at`."""
    depth = questions = 0
    for i in range(at, end):
        depth += {"(": 1, ")": -1}.get(text[i], 0)
        questions += depth == 0 and text[i] == "?"
        if text[i] == ":" and depth == 0:
            if questions == 0:
                return i
            questions -= 1
    raise ValueError(f"no : in {text!r}")
