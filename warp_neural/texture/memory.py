"""How much memory a kernel's parameters take."""

from typing import Any

import warp as wp


def bytes_of(params: Any) -> int:
    """Of all arrays in a struct of Warp and in the structs that it holds."""
    total = 0
    for name in params._cls.vars:
        value = getattr(params, name)
        if isinstance(value, wp.array):
            total += value.size * wp.types.type_size_in_bytes(value.dtype)
        elif hasattr(value, "_cls"):
            total += bytes_of(value)
    return total
