"""The course's shader: a Disney-style BRDF without sheen, clearcoat and anisotropy (Burley, "Physically-Based Shading
at Disney", 2012). Radiance is linear; directions are unit vectors in tangent space, z out of the surface."""

import warp as wp

INV_PI = wp.constant(1.0 / 3.14159265358979)
INTENSITY = wp.constant(1.5)  # of the one distant light
MIN_ALPHA = wp.constant(1.0e-3)  # a perfect mirror under a distant light has no finite radiance


@wp.func
def schlick(u: float) -> float:
    """(1 - u)^5 (Schlick 1994) in products: `pow` would cost more than the rest of the BRDF."""
    m = 1.0 - wp.clamp(u, 0.0, 1.0)
    m2 = m * m
    return m2 * m2 * m


@wp.func
def ggx_alpha(roughness: float) -> float:
    """GGX's alpha of a perceptual roughness, its square (Burley 2012, section 5.4)."""
    return wp.max(roughness * roughness, MIN_ALPHA)


@wp.func
def ggx(normal: wp.vec3, half: wp.vec3, alpha: float) -> float:
    """GTR2, i.e. GGX (Burley 2012, eq. 8): density of microfacet normals, 1/sr.

    1 + (alpha^2 - 1) (n.h)^2 is written |n x h|^2 + alpha^2 (n.h)^2: at the peak the first cancels to float32 noise.
    """
    nh = wp.dot(normal, half)
    nxh = wp.cross(normal, half)
    alpha2 = alpha * alpha
    t = wp.dot(nxh, nxh) + alpha2 * nh * nh
    return alpha2 * INV_PI / (t * t)


@wp.func
def half_vector(light: wp.vec3, view: wp.vec3) -> wp.vec3:
    """The normal of the facet that mirrors one into the other; without `wp.normalize`'s test for zero, which they
    cannot be when both are above the surface, a compiler takes it out of loops over facets."""
    both = light + view
    return both * (1.0 / wp.sqrt(wp.dot(both, both)))


@wp.func
def brdf(
    albedo: wp.vec3,
    normal: wp.vec3,
    roughness: float,
    metalness: float,
    specular: float,
    light: wp.vec3,
    view: wp.vec3,
) -> wp.vec3:
    """Radiance towards `view`: BRDF times cosine times INTENSITY, RGB. `normal` must have unit length.

    Zero where the light or the viewer is below the surface. `specular` 1 reflects 8 % at normal incidence.
    """
    nl = wp.dot(normal, light)
    nv = wp.dot(normal, view)
    color = wp.vec3(0.0)
    if nl > 0.0 and nv > 0.0:
        half = half_vector(light, view)
        lh = wp.dot(light, half)
        alpha = ggx_alpha(roughness)
        alpha2 = alpha * alpha

        fd90 = 2.0 * lh * lh * roughness - 0.5  # Fd90 - 1
        diffuse = (1.0 + fd90 * schlick(nl)) * (1.0 + fd90 * schlick(nv)) * ((1.0 - metalness) * INV_PI)

        # Smith's G divided by 4 (n.l) (n.v), one denominator for each direction
        gl = nl + wp.sqrt(alpha2 + nl * nl - alpha2 * nl * nl)
        gv = nv + wp.sqrt(alpha2 + nv * nv - alpha2 * nv * nv)
        highlight = ggx(normal, half, alpha) / (gl * gv)

        f0 = wp.vec3(0.08 * specular * (1.0 - metalness)) + albedo * metalness
        fresnel = f0 + (wp.vec3(1.0) - f0) * schlick(lh)
        color = (albedo * diffuse + fresnel * highlight) * (nl * INTENSITY)
    return color
