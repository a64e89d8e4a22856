"""What is learned: the four terms of RTXNS's Disney BRDF, and their use in a shader.

The BRDF is Burley's, "Physically-Based Shading at Disney", 2012: flattened subsurface diffuse (section 5.3), GGX with
Smith's shadowing, Schlick's Fresnel weight and a clear coat with GTR1 (section 5.4, appendix B). The cut into terms,
the encoding of the inputs and the way samples are drawn are those of "ShaderTraining" in NVIDIA's RTX Neural Shading
SDK.
"""

import warp as wp

import warp_neural as wn
from warp_neural.materials.shading import ggx_alpha, schlick

ENCODING = wn.encodings.Frequency(octaves=3)
N_IN, N_OUT = 5, 4
TERMS = ("diffuse", "specular", "Fresnel weight", "clear coat")

vec5 = wp.types.vector(N_IN, float)

INV_PI = wp.constant(1.0 / 3.141592653589793)
COAT_ALPHA2 = wp.constant(1.0e-4)
COAT_NORM = wp.constant((1.0e-4 - 1.0) / (3.141592653589793 * -9.210340371976182))  # (q - 1) / (pi ln q), q = 1e-4


@wp.func
def smith(cosine: float, alpha2: float) -> float:
    """Smith's shadowing of GGX in one direction, divided by twice the cosine."""
    return 1.0 / (cosine + wp.sqrt(alpha2 * (1.0 - cosine * cosine) + cosine * cosine))


@wp.func
def disney_terms(x: vec5) -> wp.vec4:
    """The terms of x = (N.L, N.V, N.H, L.H, roughness): diffuse, specular and clear coat in 1/sr, Fresnel in [0, 1].

    Finite where N.L + N.V > 0. 1 - (N.H)^2 is a product: at the peak the difference would be float32 noise.
    """
    nl, nv, nh, lh, roughness = x[0], x[1], x[2], x[3], x[4]
    grazing = lh * lh * roughness - 1.0
    subsurface = (1.0 + grazing * schlick(nl)) * (1.0 + grazing * schlick(nv))
    diffuse = 1.25 * INV_PI * (subsurface * (1.0 / (nl + nv) - 0.5) + 0.5)

    alpha = ggx_alpha(roughness)
    sine2 = (1.0 - nh) * (1.0 + nh)
    b = sine2 / alpha + alpha * nh * nh
    specular = smith(nl, alpha * alpha) * smith(nv, alpha * alpha) * INV_PI / (b * b)

    fresnel = schlick(lh)
    coat = COAT_NORM / (sine2 + COAT_ALPHA2 * nh * nh)
    coat *= 0.25 * (0.04 + 0.96 * fresnel) * smith(nl, 0.0625) * smith(nv, 0.0625)
    return wp.vec4(diffuse, specular, fresnel, coat)


@wp.func
def cosines(normal: wp.vec3, light: wp.vec3, view: wp.vec3, roughness: float) -> vec5:
    """The input of the terms; unit vectors, those below the surface as on the horizon."""
    half = wp.normalize(light + view)
    nl, nv, nh = wp.dot(normal, light), wp.dot(normal, view), wp.dot(normal, half)
    return vec5(
        wp.max(nl, 0.0), wp.max(nv, 0.0), wp.clamp(nh, 0.0, 1.0), wp.clamp(wp.dot(light, half), 0.0, 1.0), roughness
    )


@wp.func
def radiance(terms: wp.vec4, nl: float, base_color: wp.vec3, specular: float, metallic: float) -> wp.vec3:
    """Linear RGB under a distant light of irradiance 1 across its rays; `specular` 1 is 8 % at normal incidence."""
    f0 = wp.vec3(0.08 * specular) * (1.0 - metallic) + base_color * metallic
    fresnel = f0 + (wp.vec3(1.0) - f0) * terms[2]
    return (base_color * (terms[0] * (1.0 - metallic)) + fresnel * terms[1] + wp.vec3(terms[3])) * nl


@wp.func
def draw(index: int, random: wn.random.Stream) -> tuple[vec5, wp.vec4]:
    """A sample for training: input and terms.

    Angles are uniform: the light's elevation, in the XZ plane since only the azimuth between light and view matters,
    the view's elevation and its azimuth all around. The roughness is uniform from 0.3 to 1.
    """
    u = wn.random.uniform(random, 0)
    light = 0.5 * wp.pi * u[0]
    azimuth = wp.pi * (2.0 * u[1] - 1.0)
    view = 0.5 * wp.pi * u[2]
    l = wp.vec3(wp.cos(light), 0.0, wp.sin(light))
    v = wp.vec3(wp.cos(view) * wp.cos(azimuth), wp.cos(view) * wp.sin(azimuth), wp.sin(view))
    x = cosines(wp.vec3(0.0, 0.0, 1.0), l, v, 0.3 + 0.7 * u[3])
    return x, disney_terms(x)
