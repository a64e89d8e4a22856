"""Paths of light from the camera: what a pixel sees of a scene, by chance and right on average.

Kajiya 1986, "The Rendering Equation"; direct light by drawing from environment and material, each weighed by the power
heuristic (Veach 1997, "Robust Monte Carlo Methods for Light Transport Simulation", section 9.2); footprints in textures
by ray cones (Akenine-Möller et al. 2019, "Texture Level of Detail Strategies for Real-Time Ray Tracing").
"""

from functools import cache

import warp as wp

from warp_neural.kernels.nn.random import Stream, stream, uniform
from warp_neural.kernels.render.camera import CameraData, pixel_angle, ray_of
from warp_neural.kernels.render.environment import (
    EnvironmentData,
    bilinear,
    density_at,
    direction_of,
    place_of,
    sample_environment,
)
from warp_neural.kernels.render.geometry import Geometry, Hit, blocked, from_frame, intersect, towards
from warp_neural.kernels.render.pair import Functions

PURPOSE = wp.constant(7)  # of the random numbers
MIS, LIGHT, MATERIAL = wp.constant(0), wp.constant(1), wp.constant(2)  # what direct light is drawn by
ROULETTE = wp.constant(3)  # surfaces before paths end by chance
SURVIVAL = wp.constant(0.95)  # at most
LOBE = wp.constant(0.25)  # of a lobe's width, how much a cone widens: our choice, sharp rather than noiseless


@wp.struct
class View:
    """A scene, its light and camera. background: what the camera sees of the environment if `plain`.

    depth: surfaces of a path at most. strategy: MIS, LIGHT or MATERIAL. limit: of what one sample of one surface adds,
    in each channel. detail: of each material what is added to levels of detail, the log2 of its texels a side.
    """

    geometry: Geometry
    environment: EnvironmentData
    camera: CameraData
    background: wp.vec3
    plain: bool
    depth: int
    strategy: int
    limit: float
    detail: wp.array[float]


@wp.struct
class Film:
    """Sums over samples, [height, width]: radiance, and of the first surface albedo and normal, and whether there was
    one. dropped: samples that were not finite, which count as black."""

    radiance: wp.array2d[wp.vec3d]
    albedo: wp.array2d[wp.vec3d]
    normal: wp.array2d[wp.vec3d]
    hits: wp.array2d[int]
    dropped: wp.array2d[int]


@wp.struct
class Sample:
    radiance: wp.vec3
    albedo: wp.vec3
    normal: wp.vec3
    hit: bool


@wp.func
def weight(chance: float, other: float, ours: bool, alone: bool) -> float:
    """Of a sample drawn with density `chance` where the other strategy has `other`; alone: if there is one only."""
    ratio = other / chance
    return wp.where(alone, wp.where(ours, 1.0, 0.0), 1.0 / (1.0 + ratio * ratio))


@wp.func
def limited(color: wp.vec3, limit: float) -> wp.vec3:
    return wp.min(color, wp.vec3(limit))


@wp.func
def missed(scene: View, direction: wp.vec3, chance: float) -> wp.vec3:
    """What a ray to nowhere brings. chance: the density of its direction, negative if it comes from the camera."""
    place = place_of(scene.environment, direction)
    radiance = bilinear(scene.environment.radiance, place)
    if chance < 0.0:
        if scene.plain:
            radiance = scene.background
    else:
        other = density_at(scene.environment, place)
        radiance *= weight(chance, other, scene.strategy == MATERIAL, scene.strategy != MIS)
    return radiance


@wp.func
def level(scene: View, hit: Hit, width: float, cosine: float) -> float:
    """Of detail: the log2 of a cone's width on the surface, in texels (Akenine-Möller et al. 2019, section 20.3.4)."""
    return hit.detail[0] + wp.log2(wp.max(width, 1.0e-20) / cosine) + scene.detail[hit.material]


@wp.func
def spread_after(hit: Hit, spread: float, width: float, chance: float) -> float:
    """Of the cone that leaves a surface: curved ones widen it (there too), and so do wide lobes, a direction of density
    `chance` standing for a solid angle of 1 / chance."""
    return spread + 2.0 * hit.detail[1] * width + LOBE * wp.sqrt(1.0 / chance)


@cache
def make_trace(materials: Functions) -> wp.Function:
    """One path from the camera along `ray`; angle: of a pixel."""
    params_type, albedo = materials.params_type, materials.albedo
    direct, scatter = make_direct(materials), make_scatter(materials)

    @wp.func
    def trace(params: params_type, scene: View, random: Stream, ray: wp.vec3, angle: float) -> Sample:
        seen = Sample()
        origin, direction = wp.vec3(scene.camera.eye), wp.vec3(ray)
        throughput, chance = wp.vec3(1.0), float(-1.0)
        width, spread = float(0.0), float(angle)
        for bounce in range(scene.depth + 1):
            hit = intersect(scene.geometry, origin, direction)
            if not hit.found:
                light = wp.cw_mul(throughput, missed(scene, direction, chance))
                seen.radiance += wp.where(bounce == 0, light, limited(light, scene.limit))
                break
            if bounce == scene.depth:
                break
            width = wp.abs(width + spread * hit.distance)
            view = towards(hit, -direction)
            lod = level(scene, hit, width, view[2])
            if bounce == 0:
                seen.hit = True
                seen.normal = hit.z
                seen.albedo = albedo(params, hit.material, hit.uv, lod, view)
            u, v = uniform(random, 1 + 2 * bounce), uniform(random, 2 + 2 * bounce)
            light = wp.cw_mul(throughput, direct(params, scene, hit, lod, view, u))
            seen.radiance += limited(light, scene.limit)
            local, factor, chance = scatter(params, hit, lod, view, wp.vec3(v[0], v[1], v[2]))
            throughput = wp.cw_mul(throughput, factor)
            survival = wp.where(bounce < ROULETTE, 1.0, wp.min(wp.max(throughput), SURVIVAL))
            if wp.max(throughput) <= 0.0 or v[3] >= survival:
                break
            throughput /= survival
            spread = spread_after(hit, spread, width, chance)
            origin = hit.origin
            direction = from_frame(hit, local)
        return seen

    return trace


@cache
def make_path_kernel(materials: Functions) -> wp.Kernel:
    """dim [rows, width], from row `top` on: adds samples `first` to `first + count - 1` to the film."""
    params_type, trace = materials.params_type, make_trace(materials)

    @wp.kernel(module="unique", enable_backward=False)
    def path_kernel(params: params_type, scene: View, seed: wp.uint64, first: int, count: int, top: int, film: Film):
        row, j = wp.tid()
        i = row + top
        height, width = film.radiance.shape[0], film.radiance.shape[1]
        angle = pixel_angle(scene.camera, height)
        for n in range(first, first + count):
            random = stream(seed, n, i * width + j, PURPOSE)
            u = uniform(random, 0)
            ray = ray_of(scene.camera, float(j) + u[0], float(i) + u[1], width, height)
            add(film, i, j, trace(params, scene, random, ray, angle))

    return path_kernel


@wp.func
def add(film: Film, i: int, j: int, seen: Sample):
    """One by one, in float64: the sums do not depend on how samples were parted into launches."""
    if wp.isfinite(seen.radiance) and wp.isfinite(seen.albedo):
        film.radiance[i, j] += wp.vec3d(seen.radiance)
        film.albedo[i, j] += wp.vec3d(seen.albedo)
    else:
        film.dropped[i, j] += 1
    film.normal[i, j] += wp.vec3d(seen.normal)
    film.hits[i, j] += wp.where(seen.hit, 1, 0)


@cache
def make_direct(materials: Functions) -> wp.Function:
    """What a surface sends on of the environment's light, by one direction drawn from the environment."""
    params_type, evaluate, density = materials.params_type, materials.evaluate, materials.density

    @wp.func
    def direct(params: params_type, scene: View, hit: Hit, lod: float, view: wp.vec3, u: wp.vec4) -> wp.vec3:
        place = sample_environment(scene.environment, u[0], u[1])
        chance = density_at(scene.environment, place)
        direction = direction_of(scene.environment, place)
        light = towards(hit, direction)
        color = wp.vec3(0.0)
        if light[2] > 0.0 and chance > 0.0 and scene.strategy != MATERIAL:
            color = evaluate(params, hit.material, hit.uv, lod, light, view)
            other = density(params, hit.material, hit.uv, lod, light, view)
            color *= weight(chance, other, True, scene.strategy != MIS) / chance
            if wp.max(color) > 0.0:
                if blocked(scene.geometry, hit.origin, direction):
                    color = wp.vec3(0.0)
                else:
                    color = wp.cw_mul(color, bilinear(scene.environment.radiance, place))
        return color

    return direct


@cache
def make_scatter(materials: Functions) -> wp.Function:
    """A direction drawn by the material in the tangent frame, f cos over its density, and that density."""
    params_type, evaluate = materials.params_type, materials.evaluate
    sample, density = materials.sample, materials.density

    @wp.func
    def scatter(params: params_type, hit: Hit, lod: float, view: wp.vec3, u: wp.vec3):
        light = sample(params, hit.material, hit.uv, lod, view, u)
        factor, chance = wp.vec3(0.0), float(0.0)
        if light[2] > 0.0 and wp.isfinite(light):
            chance = density(params, hit.material, hit.uv, lod, light, view)
        if chance > 0.0:
            factor = evaluate(params, hit.material, hit.uv, lod, light, view) / chance
        return light, factor, chance

    return scatter
