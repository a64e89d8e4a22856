"""A surface seen from one side: the frame, width and energy of each lobe, and the share of light that reaches it.

Layers are joined by albedo scaling: what a layer does not reflect towards the viewer, 1 - E(view), is left for those
below (Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks", in the form of OpenPBR 1.1, "Albedo
scaling", which looks at the view alone: so a stack as a whole is not reciprocal, and conserves energy exactly where E
is exact). Facets' bounces among themselves come back with the colour of one bounce (Turquin 2019, "Practical Multiple
Scattering Compensation for Microfacet Models"): f (1 + f0 (1 - E) / E).
"""

from functools import cache

import warp as wp

from warp_neural.kernels.materials.energy import EnergyTables, long_energy, round_energy
from warp_neural.kernels.materials.ggx import alphas
from warp_neural.kernels.materials.spec import LayeredSpec
from warp_neural.kernels.materials.surface import Surface

LEAST_VIEW = wp.constant(0.01)  # cosine to a bent normal
REFLECTANCE = wp.constant(0.08)  # at normal incidence, of `specular` 1


@wp.struct
class Facets:
    """Of one lobe. frame: to its own space, rows x, y and z. view: in it. energy, share: E and q of `EnergyTables`."""

    frame: wp.mat33
    alpha: wp.vec2
    view: wp.vec3
    energy: float
    share: float


@wp.struct
class Lobes:
    """coat_share, base_share, diffuse_share, dust_share: how much of the light each one gets to reflect."""

    coat: Facets
    base: Facets
    coat_share: float
    base_share: wp.vec3
    diffuse_share: wp.vec3
    dust_share: float


@wp.func
def facing(normal: wp.vec3, view: wp.vec3) -> wp.vec3:
    """The normal, turned to the viewer as far as it looks away: else such places would be black."""
    cosine = wp.dot(normal, view)
    least = wp.min(LEAST_VIEW, view[2])
    result = normal
    if cosine < least:
        across = wp.normalize(normal - view * cosine)
        result = wp.normalize(across * wp.sqrt(1.0 - least * least) + view * least)
    return result


@wp.func
def frame_of(normal: wp.vec3, tangent: wp.vec2) -> wp.mat33:
    """Rows x, y and z = normal; x is the tangent, an angle's cosine and sine, laid into the plane of the normal."""
    flat = wp.vec3(tangent[0], tangent[1], 0.0)
    y = wp.normalize(wp.cross(normal, flat))
    return wp.matrix_from_rows(wp.cross(y, normal), y, normal)


@wp.func
def facets_of(normal: wp.vec3, tangent: wp.vec2, alpha: wp.vec2, view: wp.vec3) -> Facets:
    """Without their energy."""
    facets = Facets()
    facets.frame = frame_of(facing(normal, view), tangent)
    facets.alpha = alpha
    inside = facets.frame * view
    facets.view = wp.vec3(inside[0], inside[1], wp.max(inside[2], 1.0e-7))
    return facets


@wp.func
def reflected(f0: wp.vec3, parts: wp.vec2, facets: Facets) -> wp.vec3:
    """Facets of reflectance f0, with their further bounces: of `reflection`'s two parts, or of their integrals.

    At grazing angles they reflect all, but below 2 % at normal incidence, which no matter has, ever less (Lagarde and
    de Rousiers 2014, "Moving Frostbite to Physically Based Rendering"): 0 is no reflection at all.
    """
    grazing = wp.min(50.0 * wp.max(f0), 1.0)
    once = f0 * (parts[0] - parts[1]) + wp.vec3(grazing * parts[1])
    further = (1.0 - facets.energy) / facets.energy
    return once + wp.cw_mul(once, f0) * further


@wp.func
def reflected_albedo(f0: wp.vec3, facets: Facets) -> wp.vec3:
    return reflected(f0, wp.vec2(facets.energy, facets.energy * facets.share), facets)


@wp.func
def dielectric(specular: float) -> wp.vec3:
    return wp.vec3(wp.min(REFLECTANCE * specular, 1.0))


@wp.func
def base_reflected(surface: Surface, parts: wp.vec2, facets: Facets) -> wp.vec3:
    """Metal and dielectric, by their shares."""
    metal = reflected(surface.color, parts, facets)
    other = reflected(dielectric(surface.specular), parts, facets)
    return wp.lerp(other, metal, surface.metalness)


@wp.func
def through_coat(surface: Surface, coat: Facets) -> wp.vec3:
    """What the coat leaves for the base: absorbed along the view's refracted way, there and back (Beer's law, as
    OpenPBR 1.1, "Coat"), less what it reflects."""
    f0 = dielectric(surface.coat_specular)
    root = wp.sqrt(wp.clamp(f0[0], 1.0e-6, 0.99))  # the slope of a root at 0 has no bound
    ratio = (1.0 - root) / (1.0 + root)  # 1 / index of refraction
    sine2 = wp.max(1.0 - coat.view[2] * coat.view[2], 0.0) * ratio * ratio
    longer = 1.0 / wp.sqrt(wp.max(1.0 - sine2, 1.0e-4))
    left = wp.max(1.0 - reflected_albedo(f0, coat)[0], 0.0)
    result = wp.vec3()
    for c in range(3):
        result[c] = left * wp.exp(longer * wp.log(wp.max(surface.coat_color[c], 1.0e-6)))
    return result


@wp.func
def coat_facets(surface: Surface, tables: EnergyTables, view: wp.vec3) -> Facets:
    facets = facets_of(surface.coat_normal, wp.vec2(1.0, 0.0), alphas(surface.coat_roughness, 0.0), view)
    both = round_energy(tables, facets.view[2], facets.alpha[0])
    facets.energy = wp.min(both[0], 1.0)
    facets.share = both[1]
    return facets


@cache
def make_lobes(spec: LayeredSpec) -> wp.Function:
    """`(surface, tables, view) -> Lobes`; the view has z > 0."""
    has_coat, anisotropic = spec.coat, spec.anisotropic

    @wp.func
    def base_facets(surface: Surface, tables: EnergyTables, view: wp.vec3) -> Facets:
        facets = facets_of(surface.normal, surface.tangent, alphas(surface.roughness, surface.anisotropy), view)
        if anisotropic:
            both = long_energy(tables, facets.view, facets.alpha)
        else:
            both = round_energy(tables, facets.view[2], facets.alpha[0])
        facets.energy = wp.min(both[0], 1.0)
        facets.share = both[1]
        return facets

    @wp.func
    def lobes_of(surface: Surface, tables: EnergyTables, view: wp.vec3) -> Lobes:
        lobes = Lobes()
        lobes.dust_share = surface.dust
        lobes.base = base_facets(surface, tables, view)
        clean = 1.0 - surface.dust
        base_share = wp.vec3(clean)
        if has_coat:
            lobes.coat = coat_facets(surface, tables, view)
            lobes.coat_share = clean * surface.coat
            base_share = wp.lerp(base_share, through_coat(surface, lobes.coat) * clean, surface.coat)
        left = wp.max(1.0 - reflected_albedo(dielectric(surface.specular), lobes.base)[0], 0.0)
        lobes.base_share = base_share
        lobes.diffuse_share = base_share * (left * (1.0 - surface.metalness))
        return lobes

    return lobes_of
