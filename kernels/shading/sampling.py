"""Random light and view directions: uniform on the hemisphere, and where a glossy lobe is bright.

Integer random numbers (PCG), so that CPU and CUDA draw the same ones. Densities are per pair of directions, relative
to the uniform pair's (1 / 2 pi)^2, so 1 / density is the importance weight.
"""

import warp as wp

from warp_neural.kernels.shading.brdf import ggx, ggx_alpha, half_vector


@wp.func
def direction_around(axis: wp.vec3, cosine: float, turn: float) -> wp.vec3:
    """Unit vector at an angle of `cosine` to the unit `axis`, `turn` in [0, 1) of the way around it."""
    helper = wp.vec3(0.0, 1.0, 0.0)
    if wp.abs(axis[1]) > 0.9:
        helper = wp.vec3(1.0, 0.0, 0.0)
    x = wp.normalize(wp.cross(helper, axis))
    y = wp.cross(axis, x)
    phi = 2.0 * wp.pi * turn
    sine = wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0))
    return axis * cosine + x * (sine * wp.cos(phi)) + y * (sine * wp.sin(phi))


@wp.func
def uniform_hemisphere(u: float, v: float) -> wp.vec3:
    """The course's draw: phi = 2 pi u, cos theta = v; density 1 / 2 pi."""
    phi = 2.0 * wp.pi * u
    sine = wp.sqrt(wp.max(1.0 - v * v, 0.0))
    return wp.vec3(sine * wp.cos(phi), sine * wp.sin(phi), v)


@wp.func
def lobe_view(normal: wp.vec3, roughness: float, u: float, v: float, grazing: float) -> wp.vec3:
    """A view direction over the facet `normal`: uniform if `grazing` >= 0.5, else with density ~ 1 / (n.v + alpha)^2.

    A highlight grows as 1 / (n.v + alpha) towards grazing views: there lies most of its squared error.
    """
    cosine = v
    if grazing < 0.5:
        alpha = ggx_alpha(roughness)
        cosine = v * alpha / (1.0 + alpha - v)
    return direction_around(normal, cosine, u)


@wp.func
def lobe_light(normal: wp.vec3, roughness: float, view: wp.vec3, u: float, v: float) -> wp.vec3:
    """`view` mirrored at a microfacet drawn from the GGX density times cosine (Walter et al. 2007, eq. 35).

    Zero where the microfacet does not face the viewer: such draws count as black.
    """
    alpha = ggx_alpha(roughness)
    cosine = wp.sqrt((1.0 - u) / (1.0 + (alpha * alpha - 1.0) * u))
    half = direction_around(normal, cosine, v)
    vh = wp.dot(view, half)
    light = wp.vec3(0.0)
    if vh > 0.0:
        light = half * (2.0 * vh) - view
    return light


@wp.func
def lobe_density(normal: wp.vec3, roughness: float, light: wp.vec3, view: wp.vec3) -> float:
    """Density of (`lobe_view`, `lobe_light`), relative to a uniform pair. Without branches, for GPUs."""
    half = half_vector(light, view)
    nv = wp.max(wp.dot(normal, view), 0.0)
    nh = wp.dot(normal, half)
    alpha = ggx_alpha(roughness)
    views = 0.5 + 0.5 * alpha * (1.0 + alpha) / ((nv + alpha) * (nv + alpha))
    per_light = 0.5 * wp.pi / wp.dot(light, half)  # 1 / 4 (l.h), Walter et al. 2007, eq. 14, over 1 / 2 pi
    return wp.where(nv > 0.0, views * ggx(normal, half, alpha) * wp.max(nh, 0.0) * per_light, 0.0)
