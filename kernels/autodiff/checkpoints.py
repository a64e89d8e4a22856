"""How far apart the states lie that the backward pass of a loop keeps."""

import warp as wp


@wp.func
def stride_of(trips: int, count: int) -> int:
    """The smallest power of two of which `count` cover `trips`."""
    stride = int(1)
    while stride * count < trips:
        stride *= 2
    return stride
