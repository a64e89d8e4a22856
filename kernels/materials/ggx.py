"""Reflection by anisotropic GGX facets, in the facets' own frame: x and y along the axes, z their mean normal.

f cos = D F G2 / (4 (n.v)). With s(w) = |(alpha_x w_x, alpha_y w_y, w_z)|, Smith's correlated G2 / (4 (n.v)) is
l_z / (2 (l_z s(v) + v_z s(l))), and the density of light directions by visible normals is D / (2 (v_z + s(v)))
(Heitz 2014, "Understanding the Masking-Shadowing Function", eq. 99; Heitz 2018, "Sampling the GGX Distribution of
Visible Normals"): nothing is divided by a cosine that can be 0.
"""

import warp as wp

from warp_neural.kernels.shading.brdf import INV_PI, MIN_ALPHA, half_vector, schlick


@wp.func
def alphas(roughness: float, anisotropy: float) -> wp.vec2:
    """GGX's alpha along x and y (OpenPBR 1.1, "Microfacet model"), x is the larger: strokes of a brush run along y.

    roughness, anisotropy: in [0, 1]. Their mean square stays roughness^4. Results are in [MIN_ALPHA, 1].
    """
    aspect = 1.0 - wp.clamp(anisotropy, 0.0, 1.0)
    longer = roughness * roughness * wp.sqrt(2.0 / (1.0 + aspect * aspect))
    return wp.vec2(wp.clamp(longer, MIN_ALPHA, 1.0), wp.clamp(longer * aspect, MIN_ALPHA, 1.0))


@wp.func
def stretched(direction: wp.vec3, alpha: wp.vec2) -> float:
    """s of the direction."""
    x, y, z = direction[0] * alpha[0], direction[1] * alpha[1], direction[2]
    return wp.sqrt(x * x + y * y + z * z)


@wp.func
def facet_density(half: wp.vec3, alpha: wp.vec2) -> float:
    """D (Burley 2012, eq. 13, normalised): facets by their normals, 1/sr."""
    x, y = half[0] / alpha[0], half[1] / alpha[1]
    t = x * x + y * y + half[2] * half[2]
    return INV_PI / (alpha[0] * alpha[1] * t * t)


@wp.func
def reflection(light: wp.vec3, view: wp.vec3, alpha: wp.vec2) -> wp.vec2:
    """f cos of perfect mirrors, and that times Schlick's (1 - l.h)^5, 1/sr; both directions have z > 0.

    With a reflectance f0 at normal incidence they are f0 (a - b) + b.
    """
    half = half_vector(light, view)
    masked = light[2] / (2.0 * (light[2] * stretched(view, alpha) + view[2] * stretched(light, alpha)))
    mirrors = facet_density(half, alpha) * masked
    return wp.vec2(mirrors, mirrors * schlick(wp.dot(light, half)))


@wp.func
def visible_facet(view: wp.vec3, alpha: wp.vec2, u: float, v: float) -> wp.vec3:
    """A normal by how much of it is seen (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical
    Caps"). u, v: uniform in [0, 1)."""
    warped = wp.normalize(wp.vec3(view[0] * alpha[0], view[1] * alpha[1], view[2]))
    phi = 2.0 * wp.pi * u
    z = (1.0 - v) * (1.0 + warped[2]) - warped[2]
    sine = wp.sqrt(wp.clamp(1.0 - z * z, 0.0, 1.0))
    half = wp.vec3(sine * wp.cos(phi), sine * wp.sin(phi), z) + warped
    return wp.normalize(wp.vec3(half[0] * alpha[0], half[1] * alpha[1], wp.max(half[2], 1.0e-7)))


@wp.func
def sample_reflection(view: wp.vec3, alpha: wp.vec2, u: float, v: float) -> wp.vec3:
    """The view mirrored at a visible facet; below the surface, z <= 0, for draws that count as black."""
    half = visible_facet(view, alpha, u, v)
    return wp.normalize(half * (2.0 * wp.dot(view, half)) - view)


@wp.func
def reflection_density(light: wp.vec3, view: wp.vec3, alpha: wp.vec2) -> float:
    """Of `sample_reflection`, 1/sr, both directions with z > 0."""
    half = half_vector(light, view)
    return facet_density(half, alpha) / (2.0 * (view[2] + stretched(view, alpha)))
