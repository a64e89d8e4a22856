"""The states that the backward pass of a loop keeps: how far apart they lie, and where."""

from functools import cache

import warp as wp


@wp.func
def stride_of(trips: int, count: int) -> int:
    """The smallest power of two of which `count` cover `trips`."""
    stride = int(1)
    while stride * count < trips:
        stride *= 2
    return stride


@cache
def make_address_of(type_: type) -> wp.Function:
    """Of a variable: where the forward pass reads nothing there, compilers drop it, as they do not with `wp.zeros`."""

    @wp.func_native("return reinterpret_cast<wp::uint64>(&variable);", adj_snippet="")
    def address_of(variable: wp.ref[type_]) -> wp.uint64: ...

    return address_of
