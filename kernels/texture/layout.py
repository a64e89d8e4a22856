"""Where the trained numbers of the grids lie in one array: the weights of the taps, and the scales of the rate."""

from functools import cached_property
from math import prod
from typing import NamedTuple

from warp_neural.kernels.texture.spec import TAPS, Grid, TextureSpec

BILINEAR = 0.3  # times the weights of bilinear interpolation; trained kernels start there


class Place(NamedTuple):
    """start: in the array. shape: there, channels last, so that threads side by side read side by side."""

    start: int
    shape: tuple[int, ...]

    @property
    def end(self) -> int:
        return self.start + prod(self.shape)


def kernel_shapes(grid: Grid) -> dict[str, tuple[int, ...]]:
    if grid.kernel == "learned":
        return {"": (grid.scale, grid.scale, TAPS, grid.channels)}
    if grid.kernel == "separable":
        return {"_y": (grid.scale, 2, grid.channels), "_x": (grid.scale, 2, grid.channels)}
    return {}


class Layout:
    """Of a `TextureSpec`: `kernel_0`, `kernel_1_y` and so on as in its `tensors`, but with channels last; `scale_0`
    and so on [channels], where sigma is softplus(scale) + 0.02."""

    def __init__(self, spec: TextureSpec):
        self.spec = spec

    @cached_property
    def places(self) -> dict[str, Place]:
        shapes = {f"kernel_{g}{n}": s for g, grid in enumerate(self.spec.grids) for n, s in kernel_shapes(grid).items()}
        shapes |= {f"scale_{g}": (grid.channels,) for g, grid in enumerate(self.spec.grids)}
        places, end = {}, 0
        for name, shape in shapes.items():
            places[name] = Place(end, shape)
            end = places[name].end
        return places

    @property
    def kernels_end(self) -> int:
        """Where the scales begin."""
        return self.places["scale_0"].start

    @property
    def size(self) -> int:
        return list(self.places.values())[-1].end
