"""A material's inputs at one place, as shading wants them."""

from functools import cache

import warp as wp

from warp_neural.kernels.materials.spec import LayeredSpec
from warp_neural.kernels.materials.textures import LayeredParams, make_input

LEAST_Z = wp.constant(0.05)  # of normals, which must not lie in the surface


@wp.struct
class Surface:
    """Inputs by their names in `INPUTS`; normals of unit length, and the tangent's own angle: cosine and sine."""

    color: wp.vec3
    normal: wp.vec3
    tangent: wp.vec2
    roughness: float
    metalness: float
    specular: float
    diffuse_roughness: float
    anisotropy: float
    coat: float
    coat_normal: wp.vec3
    coat_roughness: float
    coat_specular: float
    coat_color: wp.vec3
    dust: float
    dust_color: wp.vec3
    dust_roughness: float


PARAMETERS = 27
vec_parameters = wp.types.vector(PARAMETERS, float)


@wp.func
def as_vector(surface: Surface) -> vec_parameters:
    """For networks: all fields in their order, the tangent as in `INPUTS`, by cosine and sine of twice its angle."""
    s, t = surface, surface.tangent
    double = wp.vec2(t[0] * t[0] - t[1] * t[1], 2.0 * t[0] * t[1])
    return vec_parameters(
        *s.color, *s.normal, *double, s.roughness, s.metalness, s.specular, s.diffuse_roughness, s.anisotropy,
        s.coat, *s.coat_normal, s.coat_roughness, s.coat_specular, *s.coat_color,
        s.dust, *s.dust_color, s.dust_roughness,
    )  # fmt: skip


@wp.func
def unit_normal(normal: wp.vec3) -> wp.vec3:
    """Upright where there is none."""
    return wp.normalize(wp.vec3(normal[0], normal[1], wp.max(normal[2], LEAST_Z)))


@wp.func
def half_angle(double: wp.vec2) -> wp.vec2:
    """Cosine and sine of half the vector's angle; x where it has none."""
    angle = float(0.0)
    if wp.dot(double, double) > 1.0e-12:
        angle = 0.5 * wp.atan2(double[1], double[0])
    return wp.vec2(wp.cos(angle), wp.sin(angle))


BASE = ("color", "normal", "roughness", "metalness", "specular", "diffuse_roughness", "tangent", "anisotropy")


@cache
def make_base(spec: LayeredSpec) -> wp.Function:
    """`(surface, params, index, uv, lod) -> Surface` with the base's inputs. A tangent averaged from several makes the
    anisotropy smaller by its length."""
    color, normal, roughness, metalness, specular, diffuse_roughness, tangent, anisotropy = (
        make_input(spec, name) for name in BASE
    )
    anisotropic = spec.anisotropic

    @wp.func
    def read_base(surface: Surface, params: LayeredParams, index: int, uv: wp.vec2, lod: float) -> Surface:
        result = surface
        result.color = color(params, index, uv, lod)
        result.normal = unit_normal(normal(params, index, uv, lod))
        result.roughness = roughness(params, index, uv, lod)[0]
        result.metalness = metalness(params, index, uv, lod)[0]
        result.specular = specular(params, index, uv, lod)[0]
        result.diffuse_roughness = diffuse_roughness(params, index, uv, lod)[0]
        if anisotropic:
            double = tangent(params, index, uv, lod)
            result.tangent = half_angle(double)
            result.anisotropy = anisotropy(params, index, uv, lod)[0] * wp.min(wp.length(double), 1.0)
        return result

    return read_base


@cache
def make_coat(spec: LayeredSpec) -> wp.Function:
    """`(surface, params, index, uv, lod) -> Surface` with the coat's inputs."""
    coat, normal, roughness, specular, color = (
        make_input(spec, name) for name in ("coat", "coat_normal", "coat_roughness", "coat_specular", "coat_color")
    )

    @wp.func
    def read_coat(surface: Surface, params: LayeredParams, index: int, uv: wp.vec2, lod: float) -> Surface:
        result = surface
        result.coat = coat(params, index, uv, lod)[0]
        result.coat_normal = unit_normal(normal(params, index, uv, lod))
        result.coat_roughness = roughness(params, index, uv, lod)[0]
        result.coat_specular = specular(params, index, uv, lod)[0]
        result.coat_color = color(params, index, uv, lod)
        return result

    return read_coat


@cache
def make_soil(spec: LayeredSpec) -> wp.Function:
    """`(surface, params, index, uv, lod) -> Surface` with dust, and with the roughness that fingerprints leave."""
    dust, dust_color, dust_roughness, fingerprints, print_roughness = (
        make_input(spec, name)
        for name in ("dust", "dust_color", "dust_roughness", "fingerprints", "fingerprint_roughness")
    )
    has_dust, has_fingerprints = spec.dust, spec.fingerprints

    @wp.func
    def read_soil(surface: Surface, params: LayeredParams, index: int, uv: wp.vec2, lod: float) -> Surface:
        result = surface
        if has_dust:
            result.dust = dust(params, index, uv, lod)[0]
            result.dust_color = dust_color(params, index, uv, lod)
            result.dust_roughness = dust_roughness(params, index, uv, lod)[0]
        if has_fingerprints:
            share, rough = fingerprints(params, index, uv, lod)[0], print_roughness(params, index, uv, lod)[0]
            result.coat_roughness = wp.lerp(surface.coat_roughness, rough, share)
            result.roughness = wp.lerp(surface.roughness, rough, share * (1.0 - surface.coat))
        return result

    return read_soil


@cache
def make_surface(spec: LayeredSpec) -> wp.Function:
    """`(params, index, uv, lod) -> Surface`, of the spec's maps and layers."""
    read_base, read_coat, read_soil, has_coat = make_base(spec), make_coat(spec), make_soil(spec), spec.coat

    @wp.func
    def read_surface(params: LayeredParams, index: int, uv: wp.vec2, lod: float) -> Surface:
        bare = Surface()
        bare.tangent = wp.vec2(1.0, 0.0)
        bare.coat_normal = wp.vec3(0.0, 0.0, 1.0)
        surface = read_base(bare, params, index, uv, lod)
        if has_coat:
            surface = read_coat(surface, params, index, uv, lod)
        return read_soil(surface, params, index, uv, lod)

    return read_surface
