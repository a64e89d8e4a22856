"""A mixture of two lobes with a closed form: what neural materials are sampled by.

A light l is a point on the plane z = 1, its slopes l_xy / l_z. There GGX's distribution of slopes, of alpha 1,
1 / (pi (1 + |g|^2)^2), is the cosine lobe; moved and stretched, s = m_xy / m_z + J L g, it is a lobe about a direction
m, and every point of the plane is a light above the surface: the density integrates to one, whatever the numbers. L,
lower triangular, are angles near m; J = (1 + m_xy m_xy^T / (m_z (1 + m_z))) / m_z takes them to slopes. With
q = L^-1 J^-1 (l_xy - l_z m_xy / m_z) the density is

    m_z^3 / (pi det L)  l_z / (l_z^2 + |q|^2)^2,     J^-1 = m_z (1 - m_xy m_xy^T / (1 + m_z)),

without a division by l_z. Zeltner et al. 2024 have a lobe of facets and a diffuse one likewise, but lose
what falls below the surface.
"""

import warp as wp

from warp_neural.kernels.materials.neural_spec import SAMPLER_OUTPUTS
from warp_neural.kernels.shading.brdf import INV_PI

STEEPEST = wp.constant(10.0)  # slope of the lobe's direction
LEAST_WIDTH = wp.constant(0.005)
LARGEST_WIDTH = wp.constant(2.0)
LEAST_SHARE = wp.constant(0.02)  # of either lobe: there is no light that is never drawn

vec_sampler = wp.types.vector(SAMPLER_OUTPUTS, float)


@wp.struct
class Lobe:
    """mean: m, of unit length. width: L's diagonal; skew: below it. share: of the diffuse lobe."""

    mean: wp.vec3
    width: wp.vec2
    skew: float
    share: float


@wp.func
def width_of(x: float) -> float:
    """From LEAST_WIDTH to LARGEST_WIDTH, 0.1 for 0."""
    t = 1.0 / (1.0 + wp.exp(-wp.clamp(x, -30.0, 30.0)))
    return LEAST_WIDTH * wp.exp(t * wp.log(LARGEST_WIDTH / LEAST_WIDTH))


@wp.func
def lobe_of(y: vec_sampler, view: wp.vec3) -> Lobe:
    """Of the sampler's outputs: zeros are a lobe about the mirrored view."""
    lobe = Lobe()
    far = 100.0  # networks of large weights say anything
    x = wp.vec2(wp.clamp(y[0], -far, far) - view[0], wp.clamp(y[1], -far, far) - view[1])
    z = wp.clamp(y[2], -far, far) + view[2]
    up = 0.5 * (z + wp.sqrt(z * z + 0.01))
    slopes = x * (STEEPEST / wp.sqrt(STEEPEST * STEEPEST * up * up + wp.dot(x, x) + 1.0e-12))
    lobe.mean = wp.normalize(wp.vec3(slopes[0], slopes[1], 1.0))
    lobe.width = wp.vec2(width_of(y[3]), width_of(y[4]))
    lobe.skew = 0.5 * lobe.width[1] * wp.clamp(y[5], -4.0, 4.0)
    t = 1.0 / (1.0 + wp.exp(-wp.clamp(y[6], -30.0, 30.0)))
    lobe.share = LEAST_SHARE + (1.0 - 2.0 * LEAST_SHARE) * t
    return lobe


@wp.func
def lobe_density(lobe: Lobe, light: wp.vec3) -> float:
    """Of `sample_lobe`, 1/sr; the light has z > 0."""
    m, z = lobe.mean, light[2]
    x, y = light[0] * m[2] - m[0] * z, light[1] * m[2] - m[1] * z  # m_z times the distance
    along = (x * m[0] + y * m[1]) / (1.0 + m[2])
    first = (x - m[0] * along) / lobe.width[0]
    second = (y - m[1] * along - lobe.skew * first) / lobe.width[1]
    spread = z * z + first * first + second * second
    peak = m[2] * m[2] * m[2] / (lobe.width[0] * lobe.width[1]) * z / (spread * spread)
    return INV_PI * (lobe.share * z + (1.0 - lobe.share) * peak)


@wp.func
def sample_lobe(lobe: Lobe, u: wp.vec3) -> wp.vec3:
    """A light with z > 0. u: uniform in [0, 1), the last chooses a lobe."""
    radius, phi = wp.sqrt(u[0] / (1.0 - u[0])), 2.0 * wp.pi * u[1]
    gx, gy = radius * wp.cos(phi), radius * wp.sin(phi)
    slopes = wp.vec2(gx, gy)
    if u[2] >= lobe.share:
        m = lobe.mean
        x = lobe.width[0] * gx
        y = lobe.skew * gx + lobe.width[1] * gy
        along = (x * m[0] + y * m[1]) / (m[2] * (1.0 + m[2]))
        slopes = wp.vec2(m[0] + x + m[0] * along, m[1] + y + m[1] * along) / m[2]
    return wp.normalize(wp.vec3(slopes[0], slopes[1], 1.0))
