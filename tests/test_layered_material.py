"""The layered material: values, densities and albedos against float64, energy, reciprocity, samples, gradients."""

from functools import cache

import numpy as np
import pytest
import reference_layered as reference
import warp as wp

from warp_neural.kernels.materials.layered import make_layered
from warp_neural.kernels.materials.spec import INPUTS, LayeredSpec
from warp_neural.materials.layered import LayeredMaterial, LayeredSet

STACKS = 400
ROWS = 20_000
EVERYTHING = LayeredSpec(coat=True, dust=True, fingerprints=True, anisotropic=True)


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


@pytest.mark.parametrize("layers", [True, False], ids=["all layers", "base"])
def test_values_densities_and_albedos_are_the_references(device, layers):
    rng = np.random.default_rng(5)
    inputs = random_inputs(rng, STACKS)
    if not layers:
        for name in ("coat", "dust", "fingerprints", "anisotropy"):
            inputs[name] = np.zeros((STACKS, 1))
    materials = LayeredSet(*stacks_of(inputs), device=device)
    assert materials.spec == (EVERYTHING if layers else LayeredSpec())
    index = rng.integers(0, STACKS, ROWS)
    light, view = directions(rng, ROWS, 0.02), directions(rng, ROWS, 0.02)
    light[: ROWS // 4] = reference.unit(view[: ROWS // 4] * [-1, -1, 1] + 0.05 * rng.normal(size=(ROWS // 4, 3)))
    light[:, 2] = np.abs(light[:, 2])
    light = np.float32(light).astype(float)
    chosen = {name: value[index] for name, value in inputs.items()}
    expected = reference.evaluate(chosen, tables_of(materials), light, view, long=layers)
    for got, want in zip(probe(materials, index, light, view, 0.5), expected, strict=False):
        np.testing.assert_allclose(got, want, rtol=1e-4, atol=1e-6)  # float32 of products of some 50 factors
