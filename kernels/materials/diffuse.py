"""Rough diffuse reflection without loss of energy: EON (Portsmouth, Kutz and Hill 2025, "EON: A Practical
Energy-Preserving Rough Diffuse BRDF"). Roughness 0 is Lambert's. Reciprocal."""

import warp as wp

from warp_neural.kernels.shading.brdf import INV_PI

C1 = wp.constant(0.5 - 2.0 / (3.0 * wp.pi))
C2 = wp.constant(2.0 / 3.0 - 28.0 / (15.0 * wp.pi))


@wp.func
def single_albedo(cosine: float, roughness: float) -> float:
    """Directional albedo of one bounce between white facets (E_FON), (1 - s^3) / cosine without its cancellation."""
    m = wp.clamp(cosine, 0.0, 1.0 - 1.0e-6)  # beyond it the slope of acos has no bound
    s = wp.sqrt(1.0 - m * m)
    g = s * (wp.acos(m) - s * m) + (2.0 / 3.0) * s * (m * (1.0 + s + s * s) / (1.0 + s) - 1.0)
    return (1.0 + roughness * g * INV_PI) / (1.0 + C1 * roughness)


@wp.func
def mean_single_albedo(roughness: float) -> float:
    """Of all views, weighted by their cosine."""
    return (1.0 + C2 * roughness) / (1.0 + C1 * roughness)


@wp.func
def multiple_albedo(color: wp.vec3, roughness: float) -> wp.vec3:
    """What further bounces reflect of what one leaves (rho_ms)."""
    mean = mean_single_albedo(roughness)
    result = wp.vec3()
    for c in range(3):
        result[c] = color[c] * color[c] * mean / (1.0 - color[c] * (1.0 - mean))
    return result


@wp.func
def diffuse(color: wp.vec3, roughness: float, light: wp.vec3, view: wp.vec3) -> wp.vec3:
    """f cos, 1/sr, in the frame of the normal; both directions have z > 0. color: in [0, 1]."""
    lz, vz = light[2], view[2]
    s = wp.dot(light, view) - lz * vz
    if s > 0.0:
        s = s / wp.max(lz, vz)
    single = wp.max(1.0 + roughness * s, 0.0) / (1.0 + C1 * roughness)
    left = wp.max(1.0 - single_albedo(lz, roughness), 0.0) * wp.max(1.0 - single_albedo(vz, roughness), 0.0)
    further = left / wp.max(1.0 - mean_single_albedo(roughness), 1.0e-7)
    return (color * single + multiple_albedo(color, roughness) * further) * (lz * INV_PI)


@wp.func
def diffuse_albedo(color: wp.vec3, roughness: float, cosine: float) -> wp.vec3:
    """The integral of `diffuse` over lights, exactly."""
    single = single_albedo(cosine, roughness)
    return color * single + multiple_albedo(color, roughness) * wp.max(1.0 - single, 0.0)


@wp.func
def cosine_direction(u: float, v: float) -> wp.vec3:
    """Density z / pi. u, v: uniform in [0, 1)."""
    phi, sine = 2.0 * wp.pi * u, wp.sqrt(v)
    return wp.vec3(sine * wp.cos(phi), sine * wp.sin(phi), wp.sqrt(1.0 - v))
