"""Maps of layered materials: filtering, levels, sets of several, the deluxe material; and bad input."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from scipy.ndimage import map_coordinates

from warp_neural import InputError
from warp_neural.kernels.materials.layered import make_layered
from warp_neural.kernels.materials.spec import INPUTS, LayeredSpec
from warp_neural.kernels.materials.surface import PARAMETERS, vec_parameters
from warp_neural.materials.default_material import default_material
from warp_neural.materials.deluxe import deluxe_material
from warp_neural.materials.layered import LayeredMaterial, LayeredSet, from_material
from warp_neural.materials.pyramid import halved, pyramid

READS = 2000
COLOR, NORMAL, TANGENT, ROUGHNESS, COAT = slice(0, 3), slice(3, 6), slice(6, 8), 8, 13


@cache
def make_parameters_kernel(spec: LayeredSpec) -> wp.Kernel:
    parameters = make_layered(spec).parameters

    @wp.kernel(module="unique", enable_backward=False)
    def parameters_kernel(
        params: LayeredSet.Params,
        indices: wp.array[int],
        places: wp.array[wp.vec2],
        lods: wp.array[float],
        results: wp.array[vec_parameters],
    ):
        i = wp.tid()
        results[i] = parameters(params, indices[i], places[i], lods[i])

    return parameters_kernel


def parameters_at(materials: LayeredSet, index, uv, lod) -> np.ndarray:
    """`[n, PARAMETERS]`"""
    n, device = len(uv), materials.device
    inputs = [
        wp.array(np.broadcast_to(index, n), dtype=int, device=device),
        wp.array(uv, dtype=wp.vec2, device=device),
        wp.array(np.broadcast_to(lod, n), dtype=float, device=device),
    ]
    results = wp.empty(n, dtype=vec_parameters, device=device)
    wp.launch(make_parameters_kernel(materials.spec), n, [materials.params, *inputs], [results], device=device)
    return results.numpy()


def bilinear(image, uv):
    """`image` repeated; v goes up."""
    height, width = image.shape[:2]
    at = [(1 - uv[:, 1]) * height - 0.5, uv[:, 0] * width - 0.5]
    return np.stack([map_coordinates(c, at, order=1, mode="grid-wrap") for c in np.moveaxis(image, -1, 0)], axis=-1)


def random_maps(rng, height=24, width=37):
    return {"color": rng.random((height, width, 3)), "roughness": rng.random((7, 5))}


@pytest.fixture(scope="module")
def pair(device):
    """One set of a material with two maps, and one with a map and a constant."""
    rng = np.random.default_rng(0)
    first = LayeredMaterial("first", random_maps(rng))
    second = LayeredMaterial("second", {"color": rng.random((64, 16, 3)), "roughness": 0.7})
    return LayeredSet(first, second, device=device)


def test_maps_are_filtered_repeated_and_upright(pair):
    rng = np.random.default_rng(1)
    uv, index = np.float32(rng.uniform(-2, 3, (READS, 2))), rng.integers(0, 2, READS)
    found = parameters_at(pair, index, uv, 0.0)
    for i, material in enumerate(pair.materials):
        rows = index == i
        expected = bilinear(material.inputs["color"], uv[rows].astype(float))
        np.testing.assert_allclose(found[rows, COLOR], expected, atol=2e-4)  # places to 2^-23 of 3, times 64 texels
    np.testing.assert_allclose(found[index == 1, ROUGHNESS], 0.7, rtol=1e-6)


def test_levels_are_of_the_largest_map(pair):
    """Trilinear; a map as much smaller than the largest begins to blur as many levels later."""
    rng = np.random.default_rng(2)
    uv, lod = np.float32(rng.random((READS, 2))), np.float32(rng.uniform(-1, 9, READS))
    found = parameters_at(pair, 0, uv, lod)
    for name, where, finer in (("color", COLOR, 0.0), ("roughness", slice(ROUGHNESS, ROUGHNESS + 1), np.log2(37 / 7))):
        levels = pyramid(pair.materials[0].inputs[name])
        at = np.clip(lod - finer, 0, len(levels) - 1)
        every = np.stack([bilinear(level, uv.astype(float)) for level in [*levels, levels[-1]]])
        low, share = at.astype(int), (at % 1)[:, None]
        rows = np.arange(READS)
        expected = every[low, rows] * (1 - share) + every[low + 1, rows] * share
        np.testing.assert_allclose(found[:, where], expected, atol=1e-4)


def test_the_coarsest_level_is_the_mean(pair):
    uv, color = np.random.default_rng(3).random((READS, 2)), pair.materials[0].inputs["color"]
    found = parameters_at(pair, 0, uv, 20.0)
    np.testing.assert_allclose(found[:, COLOR], np.broadcast_to(color.mean(axis=(0, 1)), (READS, 3)), atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 37])
def test_halving_keeps_the_mean(count):
    image = np.random.default_rng(0).random((count, 3, 2), np.float32)
    half = halved(image, 0)
    assert half.shape == (max(count // 2, 1), 3, 2)
    np.testing.assert_allclose(half.mean(axis=0), image.mean(axis=0), rtol=1e-5)
    if count == 5:  # texels of 2.5
        np.testing.assert_allclose(half[0], (image[0] + image[1] + image[2] / 2) / 2.5, rtol=1e-5)


def test_parameters_say_what_the_maps_do(device):
    """Normals of unit length, tangents by twice their angle, and what averaging does to anisotropy."""
    angle = np.random.default_rng(4).uniform(0, 2 * np.pi, (8, 8))
    maps = {
        "normal": np.tile([0.3, 0.0, 0.9], (8, 8, 1)),
        "tangent": np.stack([np.cos(angle), np.sin(angle)], axis=-1),
        "anisotropy": 0.8,
        "coat": 0.25,
    }
    materials = LayeredSet(LayeredMaterial("brushed", maps), device=device)
    centres = (np.stack(np.meshgrid(np.arange(8), np.arange(8)[::-1]), axis=-1).reshape(-1, 2) + 0.5) / 8
    found = parameters_at(materials, 0, centres, 0.0)
    assert found.shape == (64, PARAMETERS)
    np.testing.assert_allclose(found[:, NORMAL], np.tile([1, 0, 3] / np.sqrt(10), (64, 1)), atol=1e-6)
    np.testing.assert_allclose(found[:, TANGENT], maps["tangent"].reshape(-1, 2), atol=1e-5)
    np.testing.assert_allclose(found[:, 12], 0.8, rtol=1e-5)
    np.testing.assert_allclose(found[:, COAT], 0.25)
    mean = np.linalg.norm(maps["tangent"].mean(axis=(0, 1)))
    np.testing.assert_allclose(parameters_at(materials, 0, centres, 3.0)[:, 12], 0.8 * mean, rtol=1e-4)


def test_the_deluxe_material_has_many_maps(device):
    deluxe = deluxe_material(32)
    assert len(deluxe.maps) >= 10 and all(deluxe.layers.values())
    again = deluxe_material(32)
    assert all((deluxe.inputs[name] == again.inputs[name]).all() for name in deluxe.inputs)
    found = parameters_at(LayeredSet(deluxe, device=device), 0, np.random.default_rng(0).random((READS, 2)), 0.0)
    varied = np.ptp(found, axis=0) > 1e-3
    assert varied.sum() == PARAMETERS - 7  # but for both `specular`s, the diffuse roughness and the dust's own kind
    assert np.abs(np.linalg.norm(found[:, NORMAL], axis=-1) - 1).max() < 1e-5


def test_a_folders_maps_are_a_base(device):
    material = default_material(16)
    layered = from_material(material)
    assert layered.maps == ("color", "normal", "roughness", "metalness") and not any(layered.layers.values())
    centre = np.array([[(3 + 0.5) / 16, 1 - (5 + 0.5) / 16]])
    found = parameters_at(LayeredSet(layered, device=device), 0, centre, 0.0)[0]
    np.testing.assert_allclose(found[COLOR], material.albedo[5, 3], rtol=1e-4)
    np.testing.assert_allclose(found[NORMAL], material.normal[5, 3], atol=1e-4)
    np.testing.assert_allclose(found[ROUGHNESS], material.roughness[5, 3], rtol=1e-4)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"colour": 0.5}, "no input colour; there are color, "),
        ({"color": 0.5}, r"color has shape \(\); give 3 numbers"),
        ({"roughness": np.ones((4, 4, 3))}, r"roughness has shape \(4, 4, 3\); give 1 number, or a map"),
        ({"roughness": np.ones((0, 4))}, "roughness has shape"),
        ({"roughness": 1.5}, "roughness has values from 1.5 to 1.5; bring them into 0 to 1"),
        ({"dust": np.full((2, 2), np.nan)}, "dust has values from nan"),
        ({"normal": (0.0, 0.0, 2.0)}, "bring them into -1 to 1"),
    ],
)
def test_bad_inputs_are_named(inputs, message):
    with pytest.raises(InputError, match=message):
        LayeredMaterial("m", inputs)


def test_bad_specs_are_refused():
    with pytest.raises(InputError, match="expected names in this order"):
        LayeredSpec(maps=("roughness", "color"))
    with pytest.raises(InputError, match="coat=False: expected True, as coat is a map"):
        LayeredSpec(maps=("coat",))
    with pytest.raises(InputError, match="a set of no layered materials"):
        LayeredSet()


def test_a_set_makes_code_for_its_layers_only(device):
    plain, coated = LayeredMaterial("plain"), LayeredMaterial("coated", {"coat": 1.0, "dust": np.zeros((4, 4))})
    assert LayeredSet(plain, device=device).spec == LayeredSpec()
    idle = {
        "dust": 0.0,
        "dust_color": np.ones((4, 4, 3)),
        "coat_normal": np.ones((4, 4, 3)),
        "color": np.ones((4, 4, 3)),
    }
    assert LayeredSet(LayeredMaterial("idle", idle), device=device).spec == LayeredSpec(("color",))
    both = LayeredSet(plain, coated, device=device)
    assert both.spec == LayeredSpec(coat=True) and len(both) == 2
    found = parameters_at(both, [0, 1], np.zeros((2, 2)), 0.0)
    np.testing.assert_array_equal(found[:, COAT], [0, 1])
    assert sum(len(value) for value in INPUTS.values()) == PARAMETERS + 2  # both of fingerprints are in the roughness
