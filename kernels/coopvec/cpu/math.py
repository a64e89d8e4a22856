"""Activations of 16 floats at a time for CPU text, as compilers have no such functions: those of `math.h`."""

import re

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.native import paste

MATH = paste(NATIVE / "math.h")
FUNCTIONS = {"exp", "log", "tanh", "erf", "sin", "cos", "sqrt", "abs"}


def on_vectors(expression: str) -> str | None:
    """An activation's expression of 16 floats `z`, after `MATH` if it calls functions; None if it calls others."""
    calls = set(re.findall(r"wp::(\w+)", expression))
    return expression.replace("wp::", "Math::") if calls <= FUNCTIONS else None
