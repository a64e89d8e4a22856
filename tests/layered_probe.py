"""Layered materials for tests: random stacks, and one kernel that calls all of their functions."""

from functools import cache

import numpy as np
import reference_layered as reference
import warp as wp

from warp_neural.kernels.materials.layered import make_layered
from warp_neural.kernels.materials.spec import INPUTS, LayeredSpec
from warp_neural.materials.layered import LayeredMaterial, LayeredSet


@cache
def make_probe_kernel(spec: LayeredSpec) -> wp.Kernel:
    """All functions at once: compiling is what takes the time."""
    f = make_layered(spec)

    @wp.kernel(module="unique", enable_backward=False)
    def probe_kernel(
        params: LayeredSet.Params,
        indices: wp.array[int],
        lights: wp.array[wp.vec3],
        views: wp.array[wp.vec3],
        numbers: wp.array[wp.vec3],
        values: wp.array[wp.vec3],
        densities: wp.array[float],
        albedos: wp.array[wp.vec3],
        samples: wp.array[wp.vec3],
    ):
        i = wp.tid()
        index, view, uv = indices[i], views[i], wp.vec2(0.3, 0.6)
        values[i] = f.evaluate(params, index, uv, 0.0, lights[i], view)
        densities[i] = f.density(params, index, uv, 0.0, lights[i], view)
        albedos[i] = f.albedo(params, index, uv, 0.0, view)
        samples[i] = f.sample(params, index, uv, 0.0, view, numbers[i])

    return probe_kernel


def probe(materials: LayeredSet, indices, lights, views, numbers):
    """values, densities, albedos, samples; in float64."""
    n, device = len(views), materials.device
    inputs = [wp.array(np.broadcast_to(indices, n), dtype=int, device=device)]
    inputs += [wp.array(np.broadcast_to(x, (n, 3)), dtype=wp.vec3, device=device) for x in (lights, views, numbers)]
    results = [wp.empty(n, dtype=dtype, device=device) for dtype in (wp.vec3, float, wp.vec3, wp.vec3)]
    wp.launch(make_probe_kernel(materials.spec), n, [materials.params, *inputs], results, device=device)
    return [result.numpy().astype(float) for result in results]


def tables_of(materials: LayeredSet) -> list[np.ndarray]:
    energy = materials.params.energy
    return [getattr(energy, name).numpy() for name in ("round_energy", "round_share", "long_energy", "long_share")]


def directions(rng, n, grazing=0.0):
    """Above the surface, all over the hemisphere."""
    cosine, phi = rng.uniform(grazing, 1, n), rng.uniform(0, 2 * np.pi, n)
    sine = np.sqrt(1 - cosine**2)
    return np.float32(np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=-1)).astype(float)


def random_inputs(rng, n) -> dict[str, np.ndarray]:
    """Stacks of all layers, with maps' normals, none smoother than a roughness of 0.2."""
    inputs = {name: rng.random((n, len(default))) for name, default in INPUTS.items()}
    for name in ("roughness", "coat_roughness", "fingerprint_roughness"):
        inputs[name] = rng.uniform(0.2, 1, (n, 1))
    for name in ("normal", "coat_normal"):
        inputs[name] = reference.unit(rng.normal(size=(n, 3)) * 0.3 + [0, 0, 1])
    angle = rng.uniform(0, 2 * np.pi, n)
    inputs["tangent"] = rng.uniform(0.5, 1, (n, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return {name: np.float32(np.clip(value, -1, 1)).astype(float) for name, value in inputs.items()}


def stacks_of(inputs) -> list[LayeredMaterial]:
    count = len(inputs["color"])
    return [LayeredMaterial(f"stack {i}", {k: tuple(v[i]) for k, v in inputs.items()}) for i in range(count)]
