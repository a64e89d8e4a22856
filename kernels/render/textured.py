"""A material of maps with mip levels, shaded by the course's BRDF: a set of one.

What a set of materials is, see `warp_neural.render.materials`.
"""

import warp as wp

from warp_neural.kernels.render.geometry import bent
from warp_neural.kernels.shading.brdf import INTENSITY, INV_PI, brdf, ggx, ggx_alpha, half_vector
from warp_neural.kernels.shading.sampling import direction_around, lobe_light

SPECULAR = wp.constant(0.5)  # 4 % at normal incidence
HALF = wp.constant(0.5)  # of the draws are the highlight's
vec8 = wp.types.vector(8, float)


@wp.struct
class TexturedParams:
    """texels of level m, row by row, from first[m] on: albedo (linear), normal (y up the picture), roughness,
    metalness. sizes: height and width."""

    texels: wp.array[vec8]
    first: wp.array[int]
    sizes: wp.array[wp.vec2i]


@wp.struct
class Surface:
    albedo: wp.vec3
    normal: wp.vec3
    roughness: float
    metalness: float


@wp.func
def read_level(params: TexturedParams, level: int, uv: wp.vec2) -> vec8:
    """Bilinear; repeats."""
    height, width = params.sizes[level][0], params.sizes[level][1]
    x = (uv[0] - wp.floor(uv[0])) * float(width) - 0.5
    y = (1.0 - uv[1] + wp.floor(uv[1])) * float(height) - 0.5  # rows go down, v goes up
    left, top = wp.floor(x), wp.floor(y)
    fx, fy = x - left, y - top
    j, i = (int(left) + width) % width, (int(top) + height) % height
    start = params.first[level]
    upper, lower = start + i * width, start + (i + 1) % height * width
    right = (j + 1) % width
    above = params.texels[upper + j] * (1.0 - fx) + params.texels[upper + right] * fx
    below = params.texels[lower + j] * (1.0 - fx) + params.texels[lower + right] * fx
    return above * (1.0 - fy) + below * fy


@wp.func
def surface_at(params: TexturedParams, uv: wp.vec2, lod: float, view: wp.vec3) -> Surface:
    """Trilinear. Normals are bent until the viewer sees them."""
    level = wp.clamp(lod, 0.0, float(params.sizes.shape[0] - 1))
    fine = int(level)
    coarse = wp.min(fine + 1, params.sizes.shape[0] - 1)
    share = level - float(fine)
    texel = read_level(params, fine, uv) * (1.0 - share) + read_level(params, coarse, uv) * share
    surface = Surface()
    surface.albedo = wp.vec3(texel[0], texel[1], texel[2])
    surface.normal = bent(wp.normalize(wp.vec3(texel[3], texel[4], texel[5])), view)
    surface.roughness = texel[6]
    surface.metalness = texel[7]
    return surface


@wp.func
def textured_evaluate(
    params: TexturedParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3
) -> wp.vec3:
    s = surface_at(params, uv, lod, view)
    color = brdf(s.albedo, s.normal, s.roughness, s.metalness, SPECULAR, light, view) / INTENSITY
    return wp.where(light[2] > 0.0, color, wp.vec3(0.0))


@wp.func
def textured_sample(params: TexturedParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3) -> wp.vec3:
    """From the highlight, or by the cosine."""
    s = surface_at(params, uv, lod, view)
    light = direction_around(s.normal, wp.sqrt(1.0 - u[0]), u[1])
    if u[2] < HALF:
        light = lobe_light(s.normal, s.roughness, view, u[0], u[1])
    return light


@wp.func
def textured_density(
    params: TexturedParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3
) -> float:
    s = surface_at(params, uv, lod, view)
    half = half_vector(light, view)
    facets = ggx(s.normal, half, ggx_alpha(s.roughness)) * wp.max(wp.dot(s.normal, half), 0.0)
    highlight = facets / (4.0 * wp.max(wp.dot(view, half), 1.0e-6))
    cosine = wp.max(wp.dot(s.normal, light), 0.0) * INV_PI
    return wp.where(light[2] > 0.0, HALF * highlight + (1.0 - HALF) * cosine, 0.0)


@wp.func
def textured_albedo(params: TexturedParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3) -> wp.vec3:
    """At normal incidence."""
    s = surface_at(params, uv, lod, view)
    metal = s.albedo * s.metalness
    return s.albedo * (1.0 - s.metalness) + metal + wp.vec3(0.08 * SPECULAR * (1.0 - s.metalness))
