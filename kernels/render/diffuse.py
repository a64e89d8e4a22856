"""The simplest set of materials: Lambert's, each of one colour.

What a set of materials is, see `warp_neural.render.materials`.
"""

import warp as wp

from warp_neural.kernels.shading.brdf import INV_PI


@wp.struct
class DiffuseParams:
    """albedos: of each material, linear, in [0, 1]."""

    albedos: wp.array[wp.vec3]


@wp.func
def cosine_hemisphere(u: float, v: float) -> wp.vec3:
    """With density cos(theta) / pi (Malley's way): up from a uniform disk."""
    radius, phi = wp.sqrt(u), 2.0 * wp.pi * v
    return wp.vec3(radius * wp.cos(phi), radius * wp.sin(phi), wp.sqrt(wp.max(1.0 - u, 0.0)))


@wp.func
def diffuse_albedo(params: DiffuseParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3) -> wp.vec3:
    return params.albedos[wp.clamp(index, 0, params.albedos.shape[0] - 1)]


@wp.func
def diffuse_density(params: DiffuseParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> float:
    return wp.max(light[2], 0.0) * INV_PI


@wp.func
def diffuse_evaluate(
    params: DiffuseParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3
) -> wp.vec3:
    cosine = wp.where(view[2] > 0.0, wp.max(light[2], 0.0), 0.0)
    return diffuse_albedo(params, index, uv, lod, view) * (cosine * INV_PI)


@wp.func
def diffuse_sample(params: DiffuseParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3) -> wp.vec3:
    return cosine_hemisphere(u[0], u[1])
