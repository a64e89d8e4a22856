"""Activations of 16 floats at a time for CPU text, as compilers have no such functions: those of `math.h`."""

import re

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.native import paste

MATH = paste(NATIVE / "math.h")
FUNCTIONS = {"exp", "log", "tanh", "erf", "sin", "cos", "sqrt", "abs"}


def on_vectors(expression: str) -> str | None:
    """An activation's expression of 16 floats `z`, after `MATH` if it calls functions; None if it calls others, or if
    the language has no such expression of vectors: with comparisons as numbers, or numbers in double precision."""
    words = set(re.findall(r"\b[A-Za-z_]\w*", expression)) - {"z", "wp"}
    numbers = len(re.findall(r"[<>]=?|[=!]=|[&|]", expression)) > expression.count("?")
    double = re.search(r"\b\d+(\.\d*(e[-+]?\d+)?|e[-+]?\d+)(?![\w.])", expression)
    return expression.replace("wp::", "Math::") if words <= FUNCTIONS and not numbers and not double else None
