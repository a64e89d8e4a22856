"""The functions of a set of layered materials, as renderers and networks call them.

Directions are unit vectors in the tangent frame: x along dP/du, y along dP/dv, z the interpolated normal. u goes right
and v UP the picture. lod: the mip level, 0 the finest, of the material's largest map.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from warp_neural.kernels.materials import shade
from warp_neural.kernels.materials.spec import LayeredSpec
from warp_neural.kernels.materials.surface import as_vector, make_surface, vec_parameters
from warp_neural.kernels.materials.textures import LayeredParams


@dataclass(frozen=True)
class LayeredFunctions:
    """evaluate: `(params, index, uv, lod, light, view) -> vec3`, BRDF times cosine of the light, linear RGB, 1/sr.
    sample: `(params, index, uv, lod, view, u) -> vec3`, a light, zero where none; u: three uniform numbers in [0, 1).
    density: `(params, index, uv, lod, light, view) -> float`, of `sample`, 1/sr; its integral is 1 less the share of
    zeros. albedo: `(params, index, uv, lod, view) -> vec3`. parameters: `(params, index, uv, lod) -> vec_parameters`,
    for networks. All are zero where light or view is below the surface.
    """

    evaluate: wp.Function
    sample: wp.Function
    density: wp.Function
    albedo: wp.Function
    parameters: wp.Function


@cache
def make_layered(spec: LayeredSpec) -> LayeredFunctions:
    surface_at = make_surface(spec)
    evaluate_surface, sample_surface = shade.make_evaluate(spec), shade.make_sample(spec)
    density_of_surface, albedo_of_surface = shade.make_density(spec), shade.make_albedo(spec)

    @wp.func
    def evaluate(params: LayeredParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> wp.vec3:
        value = wp.vec3()
        if light[2] > 0.0 and view[2] > 0.0:
            value = evaluate_surface(surface_at(params, index, uv, lod), params.energy, light, view)
        return value

    @wp.func
    def sample(params: LayeredParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3) -> wp.vec3:
        return sample_surface(surface_at(params, index, uv, lod), params.energy, view, u)

    @wp.func
    def density(params: LayeredParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> float:
        return density_of_surface(surface_at(params, index, uv, lod), params.energy, light, view)

    @wp.func
    def albedo(params: LayeredParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3) -> wp.vec3:
        return albedo_of_surface(surface_at(params, index, uv, lod), params.energy, view)

    @wp.func
    def parameters(params: LayeredParams, index: int, uv: wp.vec2, lod: float) -> vec_parameters:
        return as_vector(surface_at(params, index, uv, lod))

    return LayeredFunctions(evaluate, sample, density, albedo, parameters)
