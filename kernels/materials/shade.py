"""A surface's `evaluate`, `sample`, `density` and `albedo`: sums over its lobes."""

from functools import cache

import warp as wp

from warp_neural.kernels.materials.diffuse import cosine_direction, diffuse, diffuse_albedo
from warp_neural.kernels.materials.energy import EnergyTables
from warp_neural.kernels.materials.ggx import reflection, reflection_density, sample_reflection
from warp_neural.kernels.materials.lobes import (
    Facets,
    Lobes,
    base_reflected,
    dielectric,
    make_lobes,
    reflected,
    reflected_albedo,
)
from warp_neural.kernels.materials.spec import LayeredSpec
from warp_neural.kernels.materials.surface import Surface
from warp_neural.kernels.shading.brdf import INV_PI

mat43 = wp.types.matrix(shape=(4, 3), dtype=float)


@wp.func
def base_value(surface: Surface, lobes: Lobes, light: wp.vec3) -> wp.vec3:
    """f cos of specular and diffuse base, before what lies above them."""
    inside = lobes.base.frame * light
    value = wp.vec3()
    if inside[2] > 0.0:
        parts = reflection(inside, lobes.base.view, lobes.base.alpha)
        value = wp.cw_mul(lobes.base_share, base_reflected(surface, parts, lobes.base))
        below = diffuse(surface.color, surface.diffuse_roughness, inside, lobes.base.view)
        value += wp.cw_mul(lobes.diffuse_share, below)
    return value


@wp.func
def coat_value(surface: Surface, lobes: Lobes, light: wp.vec3) -> wp.vec3:
    """f cos of the coat."""
    inside = lobes.coat.frame * light
    value = wp.vec3()
    if inside[2] > 0.0:
        parts = reflection(inside, lobes.coat.view, lobes.coat.alpha)
        value = reflected(dielectric(surface.coat_specular), parts, lobes.coat) * lobes.coat_share
    return value


@wp.func
def mean(color: wp.vec3) -> float:
    return (color[0] + color[1] + color[2]) / 3.0


@wp.func
def facets_density(facets: Facets, light: wp.vec3) -> float:
    inside = facets.frame * light
    density = float(0.0)
    if inside[2] > 0.0:
        density = reflection_density(inside, facets.view, facets.alpha)
    return density


@wp.func
def sample_facets(facets: Facets, u: float, v: float) -> wp.vec3:
    """Zero for draws below the lobe's own horizon."""
    inside = sample_reflection(facets.view, facets.alpha, u, v)
    return wp.where(inside[2] > 0.0, wp.transpose(facets.frame) * inside, wp.vec3())


@cache
def make_evaluate(spec: LayeredSpec) -> wp.Function:
    """`(surface, tables, light, view) -> vec3`: BRDF times cosine of the light, linear RGB, 1/sr."""
    lobes_of, has_coat, has_dust = make_lobes(spec), spec.coat, spec.dust

    @wp.func
    def evaluate(surface: Surface, tables: EnergyTables, light: wp.vec3, view: wp.vec3) -> wp.vec3:
        value = wp.vec3()
        if light[2] > 0.0 and view[2] > 0.0:
            lobes = lobes_of(surface, tables, view)
            value = base_value(surface, lobes, light)
            if has_coat:
                value += coat_value(surface, lobes, light)
            if has_dust:
                value += diffuse(surface.dust_color, surface.dust_roughness, light, view) * lobes.dust_share
        return value

    return evaluate


@cache
def make_albedos(spec: LayeredSpec) -> wp.Function:
    """`(surface, lobes, view) -> 4 x 3`: what coat, specular base, diffuse base and dust reflect of white light."""
    has_coat, has_dust = spec.coat, spec.dust

    @wp.func
    def albedos(surface: Surface, lobes: Lobes, view: wp.vec3) -> mat43:
        coat, dust = wp.vec3(), wp.vec3()
        parts = wp.vec2(lobes.base.energy, lobes.base.energy * lobes.base.share)
        base = wp.cw_mul(lobes.base_share, base_reflected(surface, parts, lobes.base))
        below = diffuse_albedo(surface.color, surface.diffuse_roughness, lobes.base.view[2])
        below = wp.cw_mul(lobes.diffuse_share, below)
        if has_coat:
            coat = reflected_albedo(dielectric(surface.coat_specular), lobes.coat) * lobes.coat_share
        if has_dust:
            dust = diffuse_albedo(surface.dust_color, surface.dust_roughness, view[2]) * lobes.dust_share
        return wp.matrix_from_rows(coat, base, below, dust)

    return albedos


@cache
def make_albedo(spec: LayeredSpec) -> wp.Function:
    """`(surface, tables, view) -> vec3`: the integral of `evaluate` over lights, by tables and closed forms. Normal
    maps turn part of it below the surface, which it counts and `evaluate` does not."""
    lobes_of, albedos_of = make_lobes(spec), make_albedos(spec)

    @wp.func
    def albedo(surface: Surface, tables: EnergyTables, view: wp.vec3) -> wp.vec3:
        total = wp.vec3()
        if view[2] > 0.0:
            albedos = albedos_of(surface, lobes_of(surface, tables, view), view)
            total = albedos[0] + albedos[1] + albedos[2] + albedos[3]
        return total

    return albedo


@cache
def make_chances(spec: LayeredSpec) -> wp.Function:
    """`(surface, lobes, view) -> vec4`: how often each lobe is sampled, as often as it reflects."""
    albedos_of = make_albedos(spec)

    @wp.func
    def chances(surface: Surface, lobes: Lobes, view: wp.vec3) -> wp.vec4:
        albedos = albedos_of(surface, lobes, view)
        weights = wp.vec4(mean(albedos[0]), mean(albedos[1]), mean(albedos[2]), mean(albedos[3]))
        total = weights[0] + weights[1] + weights[2] + weights[3]
        result = wp.vec4(0.0, 0.0, 1.0, 0.0)  # of black
        if total > 0.0:
            result = weights / total
        return result

    return chances


@cache
def make_density(spec: LayeredSpec) -> wp.Function:
    """`(surface, tables, light, view) -> float`: of `sample`, 1/sr."""
    lobes_of, chances_of, has_coat, has_dust = make_lobes(spec), make_chances(spec), spec.coat, spec.dust

    @wp.func
    def density(surface: Surface, tables: EnergyTables, light: wp.vec3, view: wp.vec3) -> float:
        total = float(0.0)
        if light[2] > 0.0 and view[2] > 0.0:
            lobes = lobes_of(surface, tables, view)
            chances = chances_of(surface, lobes, view)
            cosine = wp.dot(lobes.base.frame[2], light)
            total = chances[1] * facets_density(lobes.base, light) + chances[2] * wp.max(cosine, 0.0) * INV_PI
            if has_coat:
                total += chances[0] * facets_density(lobes.coat, light)
            if has_dust:
                total += chances[3] * light[2] * INV_PI
        return total

    return density


@cache
def make_sample(spec: LayeredSpec) -> wp.Function:
    """`(surface, tables, view, u) -> vec3`: a light; zero where none. u: uniform in [0, 1), the last chooses a lobe."""
    lobes_of, chances_of, has_coat, has_dust = make_lobes(spec), make_chances(spec), spec.coat, spec.dust

    @wp.func
    def sample(surface: Surface, tables: EnergyTables, view: wp.vec3, u: wp.vec3) -> wp.vec3:
        light = wp.vec3()
        if view[2] > 0.0:
            lobes = lobes_of(surface, tables, view)
            chances = chances_of(surface, lobes, view)
            before_below, before_coat = chances[1], chances[1] + chances[2]
            before_dust = before_coat + chances[0]
            if u[2] < before_below:
                light = sample_facets(lobes.base, u[0], u[1])
            elif u[2] < before_coat or not (has_coat or has_dust):
                light = wp.transpose(lobes.base.frame) * cosine_direction(u[0], u[1])
            elif has_coat and (u[2] < before_dust or not has_dust):
                light = sample_facets(lobes.coat, u[0], u[1])
            else:
                light = cosine_direction(u[0], u[1])
        return wp.where(light[2] > 0.0, light, wp.vec3())

    return sample
