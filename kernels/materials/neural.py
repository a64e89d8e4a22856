"""The functions of a set of neural materials, as renderers call them: those of `layered`, without conditions.

Directions, u and v as in `layered`; lod: 0 is the finest level of the latents.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.materials.neural_decoder import make_decode, network_of
from warp_neural.kernels.materials.neural_latents import LatentTexture, read_latents
from warp_neural.kernels.materials.neural_lobe import lobe_density, lobe_of, sample_lobe, vec_sampler
from warp_neural.kernels.materials.neural_spec import LATENTS, NeuralSpec, vec_latents

LARGEST = wp.constant(1.0e6)  # of values: exp has no bound


@cache
def make_params(spec: NeuralSpec) -> Any:
    """The struct of materials of one spec, chosen by their index: the networks' parameters and the latents."""
    decoder, layer, sampler = (network_of(each).Params for each in spec.networks.values())

    class Params:
        __annotations__ = {"decoder": decoder, "frames": layer, "sampler": sampler, "latents": LatentTexture}

    Params.__name__ = Params.__qualname__ = f"NeuralParams_{decoder.key}_{layer.key}_{sampler.key}"
    return wp.struct(Params)


@dataclass(frozen=True)
class NeuralFunctions:
    """evaluate: `(params, index, uv, lod, light, view) -> vec3`, BRDF times cosine of the light, linear RGB, 1/sr.
    sample: `(params, index, uv, lod, view, u) -> vec3`, a light, zero where the view is below the surface; u: three
    uniform numbers in [0, 1). density: `(params, index, uv, lod, light, view) -> float`, of `sample`, 1/sr, its
    integral is 1. albedo: `(params, index, uv, lod, view) -> vec3`, in [0, 1]. All are zero where light or view is
    below the surface."""

    evaluate: wp.Function
    sample: wp.Function
    density: wp.Function
    albedo: wp.Function


@cache
def make_ask(spec: NeuralSpec) -> wp.Function:
    """`(sampler's params, latents, view) -> vec_sampler`."""
    sampler = network_of(spec.sampler)
    vec_in = spec.sampler.vec_in

    @wp.func
    def ask(params: sampler.Params, latents: vec_latents, view: wp.vec3) -> vec_sampler:
        x = vec_in()
        for i in range(LATENTS):
            x[i] = latents[i]
        for i in range(3):
            x[8 + i] = view[i]
        return sampler.func(params, x)

    return ask


@wp.func
def albedo_of(y: vec_sampler) -> wp.vec3:
    result = wp.vec3()
    for c in range(3):
        result[c] = 1.0 / (1.0 + wp.exp(-wp.clamp(y[7 + c], -30.0, 30.0)))
    return result


@cache
def make_neural(spec: NeuralSpec) -> NeuralFunctions:
    params_type, decode, ask = make_params(spec), make_decode(spec), make_ask(spec)
    select_decoder, select_frames, select_sampler = (network_of(each).select for each in spec.networks.values())

    @wp.func
    def asked(params: params_type, index: int, uv: wp.vec2, lod: float, view: wp.vec3) -> vec_sampler:
        latents = read_latents(params.latents, index, uv, lod)
        return ask(select_sampler(params.sampler, index), latents, view)

    @wp.func
    def evaluate(params: params_type, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> wp.vec3:
        value = wp.vec3()
        if light[2] > 0.0 and view[2] > 0.0:
            latents = read_latents(params.latents, index, uv, lod)
            decoder, frames = select_decoder(params.decoder, index), select_frames(params.frames, index)
            value = wp.min(decode(decoder, frames, latents, light, view), wp.vec3(LARGEST))
        return value

    @wp.func
    def sample(params: params_type, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3) -> wp.vec3:
        light = wp.vec3()
        if view[2] > 0.0:
            light = sample_lobe(lobe_of(asked(params, index, uv, lod, view), view), u)
        return light

    @wp.func
    def density(params: params_type, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> float:
        result = float(0.0)
        if light[2] > 0.0 and view[2] > 0.0:
            result = lobe_density(lobe_of(asked(params, index, uv, lod, view), view), light)
        return result

    @wp.func
    def albedo(params: params_type, index: int, uv: wp.vec2, lod: float, view: wp.vec3) -> wp.vec3:
        result = wp.vec3()
        if view[2] > 0.0:
            result = albedo_of(asked(params, index, uv, lod, view))
        return result

    return NeuralFunctions(evaluate, sample, density, albedo)
