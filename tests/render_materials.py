"""Sets of materials for tests of the renderer: Lambert's, the course's BRDF, and one that shows what it is given."""

import numpy as np
import warp as wp

from warp_neural.kernels.render.diffuse import cosine_hemisphere
from warp_neural.kernels.shading.brdf import INTENSITY, INV_PI, brdf, ggx, ggx_alpha, half_vector
from warp_neural.kernels.shading.sampling import lobe_light
from warp_neural.render import Diffuse

UP = wp.constant(wp.vec3(0.0, 0.0, 1.0))


@wp.struct
class GlossyParams:
    """Of each material: albedo, and (roughness, metalness, specular)."""

    albedos: wp.array[wp.vec3]
    settings: wp.array[wp.vec3]


@wp.func
def glossy_evaluate(p: GlossyParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> wp.vec3:
    s = p.settings[index]
    return brdf(p.albedos[index], UP, s[0], s[1], s[2], light, view) / INTENSITY


@wp.func
def glossy_sample(p: GlossyParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3) -> wp.vec3:
    light = cosine_hemisphere(u[0], u[1])
    if u[2] >= 0.5:
        light = lobe_light(UP, p.settings[index][0], view, u[0], u[1])
    return light


@wp.func
def glossy_density(p: GlossyParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> float:
    half = half_vector(light, view)
    lobe = ggx(UP, half, ggx_alpha(p.settings[index][0])) * half[2] / (4.0 * wp.dot(light, half))
    return wp.where(light[2] > 0.0, 0.5 * lobe + 0.5 * light[2] * INV_PI, 0.0)


@wp.func
def glossy_albedo(p: GlossyParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3) -> wp.vec3:
    return p.albedos[index]


@wp.func
def cosine_sample(p: GlossyParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3) -> wp.vec3:
    return cosine_hemisphere(u[0], u[1])


@wp.func
def cosine_density(p: GlossyParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> float:
    return wp.max(light[2], 0.0) * INV_PI


class Glossy:
    """The course's BRDF. materials: rows of albedo (3), roughness, metalness, specular. Drawn by a mixture of the
    highlight and a cosine."""

    Params = GlossyParams
    evaluate, sample, density, albedo = glossy_evaluate, glossy_sample, glossy_density, glossy_albedo

    def __init__(self, materials: list, device: wp.DeviceLike = None):
        rows = np.array(materials, np.float32)
        self.params = GlossyParams()
        self.params.albedos = wp.array(np.ascontiguousarray(rows[:, :3]), dtype=wp.vec3, device=device)
        self.params.settings = wp.array(np.ascontiguousarray(rows[:, 3:]), dtype=wp.vec3, device=device)

    def __len__(self) -> int:
        return len(self.params.albedos)


class CosineGlossy(Glossy):
    """Drawn by a cosine alone."""

    sample, density = cosine_sample, cosine_density


@wp.func
def shown_albedo(p: Diffuse.Params, index: int, uv: wp.vec2, lod: float, view: wp.vec3) -> wp.vec3:
    return wp.vec3(uv[0], uv[1], lod)


@wp.func
def checker(uv: wp.vec2) -> float:
    return wp.where((int(wp.floor(8.0 * uv[0])) + int(wp.floor(8.0 * uv[1]))) % 2 == 0, 1.0, 0.3)


@wp.func
def checker_evaluate(p: Diffuse.Params, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> wp.vec3:
    return p.albedos[index] * (checker(uv) * light[2] * INV_PI)


class Shown(Diffuse):
    """A checker board of Lambert's; its albedo is uv and the level of detail."""

    evaluate, albedo = checker_evaluate, shown_albedo
