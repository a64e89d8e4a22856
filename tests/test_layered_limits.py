"""The layered material where numbers are extreme, and its gradients."""

from functools import cache

import numpy as np
import pytest
import reference_layered as reference
import warp as wp
from layered_probe import directions, make_probe_kernel, probe, random_inputs, tables_of

from warp_neural.kernels.materials.layered import make_layered
from warp_neural.kernels.materials.spec import CHANNELS, INPUTS, LayeredSpec, place
from warp_neural.materials.layered import LayeredMaterial, LayeredSet

MILLION = 1_000_000
EVERYTHING = LayeredSpec(coat=True, dust=True, fingerprints=True, anisotropic=True)
COLORS, ROUGHNESSES = ("color", "dust_color", "coat_color"), ("roughness", "coat_roughness")


@cache
def make_value_kernel(spec: LayeredSpec) -> wp.Kernel:
    evaluate = make_layered(spec).evaluate

    @wp.kernel(module="unique")
    def value_kernel(
        params: LayeredSet.Params, lights: wp.array[wp.vec3], views: wp.array[wp.vec3], values: wp.array[wp.vec3]
    ):
        i = wp.tid()
        values[i] = evaluate(params, i, wp.vec2(0.5, 0.5), 0.0, lights[i], views[i])

    return value_kernel


def all_layers(constants: np.ndarray, device) -> LayeredSet:
    """A set with a stack of its own for each row of constants."""
    stack = LayeredMaterial("all", {"coat": 0.5, "dust": 0.5, "fingerprints": 0.5, "anisotropy": 0.5})
    materials = LayeredSet(stack, device=device)
    assert materials.spec == EVERYTHING
    materials.params.constants = wp.array(constants, dtype=float, device=device, requires_grad=True)
    return materials


def extreme_constants(rng, n: int) -> np.ndarray:
    """Inputs at both ends of their ranges and between; normals and tangents of no length among them."""
    values = np.clip(rng.uniform(-0.5, 1.5, (n, CHANNELS)), 0, 1)
    for name in ("normal", "coat_normal", "tangent"):
        channels = slice(place(name), place(name) + len(INPUTS[name]))
        values[:, channels] = rng.integers(-1, 2, values[:, channels].shape) * rng.random((n, 1)).round(1)
    values[: n // 2, place("coat_normal") :][:, :3] = 0, 0, 1
    return values


def extreme_directions(rng, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Anywhere, then grazing to any degree, upright, equal, opposite, mirrored, in the surface and below."""
    light, view = (reference.unit(rng.normal(size=(n, 3))) for _ in range(2))
    light[:, 2], view[:, 2] = np.abs(light[:, 2]), np.abs(view[:, 2])
    kind = rng.integers(0, 10, n)
    for k, w in ((1, light), (2, view)):
        w[kind == k, 2] *= 10.0 ** -rng.uniform(0, 44, (kind == k).sum())
    view[kind == 3] = 0, 0, 1
    light[kind == 4] = view[kind == 4]
    light[kind == 5] = -view[kind == 5]
    light[kind == 6] = view[kind == 6] * [-1, -1, 1]
    light[kind == 7, 2] = 0
    both = kind == 8
    view[both, 2] *= 1e-6
    light[both] = view[both] * [-1, -1, 1]
    view[kind == 9, 2] *= -1
    return tuple(np.float32(w / np.linalg.norm(w, axis=-1, keepdims=True)) for w in (light, view))


@pytest.fixture(scope="module")
def extremes():
    rng = np.random.default_rng(0)
    return extreme_constants(rng, MILLION), *extreme_directions(rng, MILLION), rng.random((MILLION, 3), np.float32)


def test_a_million_extreme_inputs_give_numbers(device, extremes):
    constants, light, view, numbers = extremes
    materials = all_layers(constants, device)
    values, densities, albedos, samples = probe(materials, np.arange(MILLION), light, view, numbers)
    for result in (values, densities, albedos, samples):
        assert np.isfinite(result).all()
    assert values.min() >= 0 and densities.min() >= 0 and albedos.min() >= 0 and albedos.max() < 1 + 1e-4
    below = (light[:, 2] <= 0) | (view[:, 2] <= 0)
    assert below.mean() > 0.2 and not values[below].any() and not densities[below].any()
    assert not albedos[view[:, 2] <= 0].any() and not samples[view[:, 2] <= 0].any()
    length = np.linalg.norm(samples, axis=-1)
    assert ((np.abs(length - 1) < 1e-4) & (samples[:, 2] > 0) | (length == 0)).all()
    assert (length > 0).mean() > 0.5


def test_a_million_extreme_gradients_are_numbers(device, extremes):
    """All of them, those of colours not negative: more colour is more light."""
    constants, light, view, _numbers = extremes
    gradients = gradients_of(constants, light, view, device)
    assert np.isfinite(gradients).all()
    for name in COLORS:
        assert gradients[:, place(name) :][:, :3].min() >= 0, name
    assert (gradients[:, place("roughness")] != 0).mean() > 0.2


def gradients_of(constants, light, view, device) -> np.ndarray:
    """Of the sum of the three channels, to each row's constants."""
    materials = all_layers(constants, device)
    inputs = [wp.array(w, dtype=wp.vec3, device=device) for w in (light, view)]
    values = wp.zeros(len(light), dtype=wp.vec3, device=device, requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(make_value_kernel(EVERYTHING), len(light), [materials.params, *inputs], [values], device=device)
    values.grad.fill_(1.0)
    tape.backward()
    return materials.params.constants.grad.numpy()


def test_gradients_are_the_references(device):
    """Central differences of the float64 reference, by colours and roughnesses."""
    rng, n = np.random.default_rng(1), 500
    inputs = random_inputs(rng, n)
    inputs["roughness"] = np.clip(inputs["roughness"], 0.3, 0.9)
    light, view = directions(rng, n, 0.1), directions(rng, n, 0.1)
    constants = np.concatenate([inputs[name] for name in INPUTS], axis=1)
    found = gradients_of(constants, light, view, device)
    tables = tables_of(all_layers(constants, device))
    step = 1e-5
    for name in (*COLORS, *ROUGHNESSES, "metalness", "coat", "dust"):
        for c in range(len(INPUTS[name])):
            ends = []
            for sign in (-1, 1):
                moved = inputs[name].copy()
                moved[:, c] += sign * step
                ends.append(reference.evaluate({**inputs, name: moved}, tables, light, view)[0].sum(axis=-1))
            expected = (ends[1] - ends[0]) / (2 * step)
            close = np.isclose(found[:, place(name) + c], expected, rtol=2e-3, atol=2e-4)
            assert close.mean() > 0.99, (name, c)  # but where a step crosses a seam between nodes of the tables


def test_compiles_for_hopper(tmp_path):
    """The gradients of the base alone: those of all layers take most of a minute."""
    for kernel in (make_probe_kernel(EVERYTHING), make_value_kernel(LayeredSpec())):
        (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path / kernel.key)
        assert artifact.stat().st_size > 0
