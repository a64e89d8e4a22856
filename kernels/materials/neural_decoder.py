"""The decoder: latents, light and view to BRDF times cosine, in learned shading frames.

After Zeltner et al. 2024, "Real-Time Neural Appearance Models": a linear layer takes two frames from the
latents, directions are turned into both by fixed arithmetic, and the network has no rotations to learn.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from warp_neural.kernels.coopvec.network import make_network
from warp_neural.kernels.coopvec.typed import make_params_type, make_select, make_typed
from warp_neural.kernels.materials.neural_spec import LATENTS, NeuralSpec, vec_latents
from warp_neural.kernels.nn.spec import NetworkSpec

TINY = wp.constant(1.0e-6)  # squared length, added: nothing is divided by zero, in the gradient neither
vec6, vec12 = wp.types.vector(6, float), wp.types.vector(12, float)


class Network(NamedTuple):
    """Params: the struct of its parameters, an `MLP`'s of that shape. func: `(params, x) -> vec`. select: `(params, i)
    -> params` with another of its networks."""

    Params: Any
    func: wp.Function
    select: wp.Function


@cache
def network_of(spec: NetworkSpec) -> Network:
    params_type = make_params_type(spec, None, spec.sizes[0], 0)
    return Network(params_type, make_typed(make_network(spec), params_type, spec.vec_out), make_select(params_type))


@wp.func
def near_unit(v: wp.vec3) -> wp.vec3:
    return v * (1.0 / wp.sqrt(wp.dot(v, v) + TINY))


@wp.func
def frame_from(normal: wp.vec3, tangent: wp.vec3) -> wp.mat33:
    """Rows x, y and z = normal, orthonormal: Gram and Schmidt's, of any two vectors that are not parallel."""
    z = near_unit(normal)
    x = near_unit(tangent - z * wp.dot(z, tangent))
    return wp.matrix_from_rows(x, wp.cross(z, x), z)


@wp.func
def frame_of_outputs(y: vec12, first: int) -> wp.mat33:
    """The layer's outputs are added to the surface's own frame, where training begins."""
    normal = wp.vec3(y[first], y[first + 1], y[first + 2] + 1.0)
    tangent = wp.vec3(y[first + 3] + 1.0, y[first + 4], y[first + 5])
    return frame_from(normal, tangent)


@wp.func
def difference_vector(light: wp.vec3, half: wp.vec3) -> wp.vec3:
    """The light in a frame whose z is the half vector: turned about z, then about y (Rusinkiewicz 1998, "A New Change
    of Variables for Efficient BRDF Representation")."""
    sine2 = half[0] * half[0] + half[1] * half[1]
    result = light
    if sine2 > 1.0e-12:  # there the frame turns at once, and a slope has no bound
        sine = wp.sqrt(sine2)
        x = (half[0] * light[0] + half[1] * light[1]) / sine
        y = (half[0] * light[1] - half[1] * light[0]) / sine
        result = wp.vec3(half[2] * x - sine * light[2], y, sine * x + half[2] * light[2])
    return result


@cache
def make_pair(spec: NeuralSpec) -> wp.Function:
    """`(light, view) -> 6 numbers`, in whatever frame they are given."""
    halves = spec.directions == "half_difference"

    @wp.func
    def pair(light: wp.vec3, view: wp.vec3) -> vec6:
        first, second = light, view
        if halves:
            first = near_unit(light + view)
            second = difference_vector(light, first)
        return vec6(first[0], first[1], first[2], second[0], second[1], second[2])

    return pair


@cache
def make_inputs(spec: NeuralSpec) -> wp.Function:
    """`(frame layer's params, latents, light, view) -> vec`, what the decoder reads."""
    layer, pair = network_of(spec.frame_layer), make_pair(spec)
    vec_in = spec.decoder.vec_in

    @wp.func
    def with_latents(latents: vec_latents) -> vec_in:
        x = vec_in()
        for i in range(LATENTS):
            x[i] = latents[i]
        return x

    @wp.func
    def inputs_of_surface(params: layer.Params, latents: vec_latents, light: wp.vec3, view: wp.vec3) -> vec_in:
        x, own = with_latents(latents), pair(light, view)
        for i in range(6):
            x[8 + i] = own[i]
        return x

    @wp.func
    def inputs_of_frames(params: layer.Params, latents: vec_latents, light: wp.vec3, view: wp.vec3) -> vec_in:
        x, y = with_latents(latents), layer.func(params, latents)
        a, b = frame_of_outputs(y, 0), frame_of_outputs(y, 6)
        first, second = pair(a * light, a * view), pair(b * light, b * view)
        for i in range(6):
            x[8 + i] = first[i]
            x[14 + i] = second[i]
        return x

    return inputs_of_frames if spec.frames else inputs_of_surface


@cache
def make_decode(spec: NeuralSpec) -> wp.Function:
    """`(decoder's params, frame layer's params, latents, light, view) -> vec3`: BRDF times cosine of the light, linear
    RGB, 1/sr, of any directions. Differentiable."""
    decoder, layer, inputs = network_of(spec.decoder), network_of(spec.frame_layer), make_inputs(spec)

    @wp.func
    def decode(
        params: decoder.Params, frames: layer.Params, latents: vec_latents, light: wp.vec3, view: wp.vec3
    ) -> wp.vec3:
        return decoder.func(params, inputs(frames, latents, light, view))

    return decode
