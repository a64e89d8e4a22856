"""Sets of materials, as the path tracer takes them.

A set is any object with `params`, an instance of its struct `Params`, and these Warp functions, which any thread may
call for its material number `index`, with different ones beside it:

    evaluate(params, index: int, uv: vec2, lod: float, light: vec3, view: vec3) -> vec3   # BRDF times cosine, 1/sr
    sample(params, index, uv, lod, view, u: vec3) -> vec3     # a direction of light; zero, or z <= 0, where none
    density(params, index, uv, lod, light, view) -> float     # of `sample`, 1/sr
    albedo(params, index, uv, lod, view) -> vec3              # the share that is reflected

Colours are linear RGB. Directions are unit vectors away from the surface in the tangent frame: x along dP/du, y along
dP/dv (v goes up the picture), z the smooth normal; views have z > 0. u: uniform in [0, 1)^3. lod: the log2 of the ray's
footprint in texels, of which the material's texture has `texels` a side: an attribute of the set, a number or one for
each material, the last one for all after it, 1 if there is none. A set may have a length, its number of materials.
"""

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.errors import is_finite, require, require_whole
from warp_neural.kernels.render.diffuse import (
    DiffuseParams,
    diffuse_albedo,
    diffuse_density,
    diffuse_evaluate,
    diffuse_sample,
)
from warp_neural.kernels.render.pair import Functions, make_pair

NAMES = "params", "Params", "evaluate", "sample", "density", "albedo"


class Diffuse:
    """A set of Lambert materials. albedos: their linear colours in [0, 1], [n, 3]."""

    Params = DiffuseParams
    evaluate, sample = staticmethod(diffuse_evaluate), staticmethod(diffuse_sample)
    density, albedo = staticmethod(diffuse_density), staticmethod(diffuse_albedo)

    def __init__(self, albedos: np.ndarray, *, device: wp.DeviceLike = None):
        try:
            colors = np.array(albedos, np.float32)
        except (TypeError, ValueError):
            colors = np.empty(0)
        if colors.ndim != 2 or colors.shape[1] != 3 or not len(colors) or not ((0 <= colors) & (colors <= 1)).all():
            raise InputError(f"albedos of shape {colors.shape}: expected [n, 3] in [0, 1]")
        self.params = DiffuseParams()
        self.params.albedos = wp.array(colors, dtype=wp.vec3, device=find_device(device))

    def __len__(self) -> int:
        return len(self.params.albedos)


class Combined:
    """What `combine` makes."""

    def __init__(self, first: object, second: object, split: int):
        functions = make_pair(functions_of(first), functions_of(second))
        self.Params, self.evaluate, self.sample, self.density, self.albedo = functions
        self.params = self.Params()
        self.params.first, self.params.second, self.params.split = first.params, second.params, split
        self.texels = [*texels_of(first, split), *texels_of(second)]
        self.second = second

    def __len__(self) -> int:
        return self.params.split + count_of(self.second)


def combine(first: object, second: object, split: int | None = None) -> Combined:
    """A set of the materials of two: numbers below `split` are the first's, from there on the second's.

    split: the first set's length if it has one. Two sets may be combined again.
    """
    split = count_of(first) if split is None else split
    if not split:
        raise InputError("split: the first set has no length; say how many materials it has")
    require_whole("split", split)
    return Combined(first, second, split)


def functions_of(materials: object) -> Functions:
    missing = [name for name in NAMES if not hasattr(materials, name)]
    if missing:
        raise InputError(f"materials: {type(materials).__name__} has no {', '.join(missing)}; see wn.render.materials")
    return Functions(materials.Params, materials.evaluate, materials.sample, materials.density, materials.albedo)


def count_of(materials: object) -> int | None:
    """How many there are; None if the set does not say."""
    try:
        return len(materials)
    except TypeError:
        return None


def texels_of(materials: object, count: int | None = None) -> list[float]:
    """Of the first `count` materials, or of as many as the set tells of."""
    texels = getattr(materials, "texels", 1)
    texels = list(texels) if np.ndim(texels) else [texels]
    require(bool(texels) and all(is_finite(n) and n > 0 for n in texels), "texels", texels, "numbers above 0")
    return texels if count is None else (texels + texels[-1:] * count)[:count]
