"""What training launches: samples of the reference, latents by encoder or by texture, and the losses' adjoints."""

from functools import cache

import warp as wp

from warp_neural.kernels.materials import shade
from warp_neural.kernels.materials.neural import albedo_of, make_ask
from warp_neural.kernels.materials.neural_decoder import make_decode, network_of
from warp_neural.kernels.materials.neural_latents import read_trained
from warp_neural.kernels.materials.neural_lobe import lobe_density, lobe_of
from warp_neural.kernels.materials.neural_spec import NeuralSpec, vec_latents
from warp_neural.kernels.materials.spec import LayeredSpec
from warp_neural.kernels.materials.surface import PARAMETERS, as_vector, make_surface, vec_parameters
from warp_neural.kernels.materials.textures import LayeredParams
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.random import stream, uniform
from warp_neural.kernels.nn.spec import FLOAT32, NetworkSpec
from warp_neural.kernels.shading.brdf import INV_PI
from warp_neural.kernels.shading.sampling import uniform_hemisphere

ENCODER = NetworkSpec((PARAMETERS, 64, 64, 64, 8), activations.leaky_relu, activations.linear, FLOAT32)
"""The material's own parameters to latents; thrown away when they are baked."""

FINEST = wp.constant(0.8)  # of the places; the others are spread over the coarser levels
DARK = wp.constant(0.02)  # f cos from where on differences count by their ratio
MOST_WEIGHT = wp.constant(8.0)  # of a light in the sampler's loss; beyond it are lights that mixtures hardly ever draw


@wp.struct
class Draws:
    """Of one step. place: u, v, level. parameters: of each place, at which there are `pairs` of directions: light, view
    and target (f cos), and where the sampler learns, its weight (f cos / density / albedo, gray) and albedo."""

    place: wp.array[wp.vec3]
    parameters: wp.array[vec_parameters]
    light: wp.array[wp.vec3]
    view: wp.array[wp.vec3]
    target: wp.array[wp.vec3]
    weight: wp.array[float]
    albedo: wp.array[wp.vec3]


@wp.func
def place_of(u: wp.vec4, levels: int) -> wp.vec3:
    """Anywhere, mostly at the finest of the levels."""
    level = float(0.0)
    if u[2] >= FINEST and levels > 1:
        level = wp.min(1.0 + wp.floor(u[3] * float(levels - 1)), float(levels - 1))
    return wp.vec3(u[0], u[1], level)


@cache
def make_draw_kernel(spec: LayeredSpec, pairs: int, for_sampler: bool) -> wp.Kernel:
    """Views uniform on the hemisphere; lights one half likewise, the other by the material's own `sample`.

    Samples are not weighted by 1 / density for the decoder: its loss is of logarithms, bounded where a highlight is,
    and weights would turn half of the batch, which sees highlights, into next to nothing. The sampler's loss is an
    integral over lights, and has weights.
    """
    surface_at, evaluate, sample = make_surface(spec), shade.make_evaluate(spec), shade.make_sample(spec)
    density, albedo = shade.make_density(spec), shade.make_albedo(spec)

    @wp.kernel(module="unique", enable_backward=False)
    def draw_kernel(
        params: LayeredParams, index: int, levels: int, lod: float, seed: wp.uint64, steps: wp.array[int], purpose: int,
        draws: Draws,
    ):  # fmt: skip
        n = wp.tid()
        random = stream(seed, steps[0], n, purpose)
        place = place_of(uniform(random, 0), levels)
        surface = surface_at(params, index, wp.vec2(place[0], place[1]), lod + place[2])
        draws.place[n] = place
        draws.parameters[n] = as_vector(surface)
        for k in range(pairs):
            i, a, b = n * pairs + k, uniform(random, 2 * k + 1), uniform(random, 2 * k + 2)
            view = uniform_hemisphere(a[0], wp.max(a[1], 1.0e-3))
            light = uniform_hemisphere(a[2], wp.max(a[3], 1.0e-3))
            if b[3] < 0.5:
                own = sample(surface, params.energy, view, wp.vec3(b[0], b[1], b[2]))
                if own[2] > 0.0:
                    light = own
            target = evaluate(surface, params.energy, light, view)
            draws.light[i] = light
            draws.view[i] = view
            draws.target[i] = target
            if for_sampler:
                whole = albedo(surface, params.energy, view)
                mixture = 0.25 * INV_PI + 0.5 * density(surface, params.energy, light, view)
                gray = (target[0] + target[1] + target[2]) / wp.max(whole[0] + whole[1] + whole[2], 1.0e-3)
                draws.weight[i] = wp.min(gray / mixture, MOST_WEIGHT)
                draws.albedo[i] = whole

    return draw_kernel


@cache
def make_encode_kernel() -> wp.Kernel:
    """Latents of the draws' places."""
    encoder = network_of(ENCODER)

    @wp.kernel(module="unique")
    def encode_kernel(params: encoder.Params, parameters: wp.array[vec_parameters], latents: wp.array[vec_latents]):
        n = wp.tid()
        latents[n] = encoder.func(params, parameters[n])

    return encode_kernel


@cache
def make_bake_kernel(spec: LayeredSpec) -> wp.Kernel:
    """The encoder's latents of each texel of a level, at its centre."""
    encoder, surface_at = network_of(ENCODER), make_surface(spec)

    @wp.kernel(module="unique", enable_backward=False)
    def bake_kernel(
        params: LayeredParams,
        index: int,
        lod: float,
        net: encoder.Params,
        level: wp.vec3i,
        texels: wp.array[vec_latents],
    ):
        row, column = wp.tid()
        uv = wp.vec2((float(column) + 0.5) / float(level[2]), 1.0 - (float(row) + 0.5) / float(level[1]))
        parameters = as_vector(surface_at(params, index, uv, lod))
        texels[level[0] + row * level[2] + column] = encoder.func(net, parameters)

    return bake_kernel


@wp.kernel(module="unique")
def read_kernel(
    texels: wp.array[vec_latents], levels: wp.array[wp.vec3i], place: wp.array[wp.vec3], latents: wp.array[vec_latents]
):
    """Latents of the draws' places from a trainable texture."""
    n = wp.tid()
    at = place[n]
    latents[n] = read_trained(texels, levels[int(at[2])], wp.vec2(at[0], at[1]))


@cache
def make_loss_kernel(spec: NeuralSpec, pairs: int) -> wp.Kernel:
    """Mean over RGB of |log(DARK + prediction) - log(DARK + target)|, of each pair.

    Errors are reported with 1 for DARK, as utracer trains. There a diffuse base of 0.05 counts nothing beside a
    highlight of 100, and its gradient fades with exp: decoders went black where no highlight was, and stayed so.
    """
    decoder, layer, decode = network_of(spec.decoder), network_of(spec.frame_layer), make_decode(spec)

    @wp.kernel(module="unique")
    def loss_kernel(
        params: decoder.Params,
        frames: layer.Params,
        latents: wp.array[vec_latents],
        draws: Draws,
        loss: wp.array[float],
    ):
        i = wp.tid()
        value, target = decode(params, frames, latents[i / pairs], draws.light[i], draws.view[i]), draws.target[i]
        total = float(0.0)
        for c in range(3):
            total += wp.abs(wp.log(DARK + value[c]) - wp.log(DARK + target[c]))
        loss[i] = total / 3.0

    return loss_kernel


@cache
def make_sampler_loss_kernel(spec: NeuralSpec, pairs: int) -> wp.Kernel:
    """Cross entropy of the lobe's density against f cos, which differs from the Kullback-Leibler divergence by what
    training cannot change; and the squared error of the albedo."""
    sampler, ask = network_of(spec.sampler), make_ask(spec)

    @wp.kernel(module="unique")
    def sampler_loss_kernel(
        params: sampler.Params, latents: wp.array[vec_latents], draws: Draws, loss: wp.array[float]
    ):
        i = wp.tid()
        view = draws.view[i]
        y = ask(params, latents[i / pairs], view)
        difference = albedo_of(y) - draws.albedo[i]
        entropy = draws.weight[i] * wp.log(lobe_density(lobe_of(y, view), draws.light[i]) + 1.0e-8)
        loss[i] = 10.0 * wp.dot(difference, difference) - entropy

    return sampler_loss_kernel


@cache
def make_error_kernel(params_type, evaluate: wp.Function) -> wp.Kernel:
    """|log(1 + value) - log(1 + target)| of a material against draws of one pair a place; mean over RGB."""

    @wp.kernel(module="unique", enable_backward=False)
    def error_kernel(params: params_type, index: int, draws: Draws, error: wp.array[float]):
        i = wp.tid()
        at = draws.place[i]
        value = evaluate(params, index, wp.vec2(at[0], at[1]), at[2], draws.light[i], draws.view[i])
        total = float(0.0)
        for c in range(3):
            total += wp.abs(wp.log(1.0 + value[c]) - wp.log(1.0 + draws.target[i][c]))
        error[i] = total / 3.0

    return error_kernel
