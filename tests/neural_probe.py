"""Neural materials for tests: untrained ones of random numbers, and one kernel that calls all of their functions."""

from functools import cache

import numpy as np
import warp as wp

from warp_neural.kernels.materials.neural import make_neural, make_params
from warp_neural.kernels.materials.neural_spec import LATENTS, NeuralSpec
from warp_neural.materials.neural import NeuralMaterial
from warp_neural.materials.neural_state import NeuralState
from warp_neural.nn.state import NetworkState


def random_state(spec: NeuralSpec, seed: int, side: int = 8, scale: float = 1.0) -> NeuralState:
    """scale: of weights, in standard deviations of 1 / sqrt(inputs)."""
    rng, networks = np.random.default_rng(seed), {}
    for name, network in spec.networks.items():
        weights = [scale * rng.normal(0, 1 / np.sqrt(k), (n, k)) for k, n in network.layers]
        biases = [scale * rng.normal(0, 0.3, n) for _, n in network.layers]
        networks[name] = NetworkState.of_layers(network, weights, biases)
    sizes = [max(side >> level, 1) for level in range(side.bit_length())]
    codes = tuple(rng.integers(0, 256, (size, size, LATENTS), np.uint8) for size in sizes)
    step = np.float32(rng.uniform(0.01, 0.02, LATENTS))
    return NeuralState(spec, networks, codes, np.stack([-128 * step, step], axis=-1), f"random {seed}", {"error": 0.5})


@cache
def make_probe_kernel(spec: NeuralSpec) -> wp.Kernel:
    """All functions at once: compiling is what takes the time."""
    f, params_type = make_neural(spec), make_params(spec)

    @wp.kernel(module="unique", enable_backward=False)
    def probe_kernel(
        params: params_type,
        indices: wp.array[int],
        places: wp.array[wp.vec3],
        lights: wp.array[wp.vec3],
        views: wp.array[wp.vec3],
        numbers: wp.array[wp.vec3],
        values: wp.array[wp.vec3],
        densities: wp.array[float],
        albedos: wp.array[wp.vec3],
        samples: wp.array[wp.vec3],
    ):
        i = wp.tid()
        index, view, uv, lod = indices[i], views[i], wp.vec2(places[i][0], places[i][1]), places[i][2]
        values[i] = f.evaluate(params, index, uv, lod, lights[i], view)
        densities[i] = f.density(params, index, uv, lod, lights[i], view)
        albedos[i] = f.albedo(params, index, uv, lod, view)
        samples[i] = f.sample(params, index, uv, lod, view, numbers[i])

    return probe_kernel


def probe(material: NeuralMaterial, indices, places, lights, views, numbers):
    """values, densities, albedos, samples; in float64."""
    n, device = max(len(np.atleast_2d(x)) for x in (places, lights, views)), material.device
    inputs = [wp.array(np.broadcast_to(indices, n), dtype=int, device=device)]
    vectors = (places, lights, views, numbers)
    inputs += [wp.array(np.broadcast_to(x, (n, 3)), dtype=wp.vec3, device=device) for x in vectors]
    results = [wp.empty(n, dtype=dtype, device=device) for dtype in (wp.vec3, float, wp.vec3, wp.vec3)]
    wp.launch(make_probe_kernel(material.spec), n, [material.params, *inputs], results, device=device)
    return [result.numpy().astype(float) for result in results]
