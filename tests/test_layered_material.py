"""The layered material: values, densities and albedos against float64, energy, reciprocity, samples."""

import numpy as np
import pytest
import reference_layered as reference
from layered_probe import directions, probe, random_inputs, stacks_of, tables_of
from scipy.stats import chi2, qmc

from warp_neural.kernels.materials.spec import LayeredSpec
from warp_neural.materials.energy import energy_tables
from warp_neural.materials.layered import LayeredMaterial, LayeredSet

STACKS = 400
ROWS = 20_000
EVERYTHING = LayeredSpec(coat=True, dust=True, fingerprints=True, anisotropic=True)
ALL_LAYERS = LayeredMaterial("all", {"coat": 0.5, "dust": 0.5, "fingerprints": 0.5, "anisotropy": 0.5})


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


@pytest.mark.parametrize("alpha", [(0.09, 0.09), (0.5, 0.5), (1.0, 1.0), (0.5, 0.1), (0.04, 0.25)])
@pytest.mark.parametrize("cosine", [0.05, 0.3, 0.9])
def test_tables_hold_the_energy_of_mirrors(device, alpha, cosine):
    """Against a quadrature of another kind. Within 0.8 %: linear between their nodes."""
    turn = 0.6
    sine = np.sqrt(1 - cosine**2)
    view = np.array([sine * np.cos(turn), sine * np.sin(turn), cosine])
    tables = energy_tables(str(device), True)
    held = [getattr(tables, name).numpy() for name in ("round_energy", "round_share", "long_energy", "long_share")]
    energy, share = reference.mirrors_energy(view, alpha)
    for long in [True] if alpha[0] != alpha[1] else [True, False]:
        e, q = reference.energy(held, view[None], np.array([alpha]), long)
        np.testing.assert_allclose(e, energy, rtol=0.008)
        np.testing.assert_allclose(q * e, share * energy, atol=0.008)


WHITE = {"color": (1.0, 1.0, 1.0), "dust_color": (1.0, 1.0, 1.0), "fingerprint_roughness": 0.6}
FURNACES = {
    "diffuse": {"specular": 0.0},
    "rough diffuse": {"specular": 0.0, "diffuse_roughness": 1.0},
    "dust": {"dust": 1.0, "dust_roughness": 0.7},
    "metal": {"metalness": 1.0},
    "brushed metal": {"metalness": 1.0, "anisotropy": 0.8, "tangent": (0.0, 1.0)},
    "dielectric": {},
    "brushed dielectric": {"anisotropy": 0.8, "diffuse_roughness": 0.5},
    "gem": {"specular": 3.0},
    "coated metal": {"metalness": 1.0, "coat": 1.0},
    "coated dielectric": {"coat": 1.0, "coat_specular": 1.0},
    "all": {"metalness": 0.4, "coat": 0.7, "dust": 0.3, "fingerprints": 0.5, "anisotropy": 0.6},
}
ROUGHNESSES = (0.0, 0.07, 0.15, 0.4, 0.7, 1.0)
COSINES = (1.0, 0.6, 0.2, 0.05, 0.01)


def integrals(materials, views, count=4096):
    """Of f cos over lights, by `count` samples of each material and view, `[materials, views, 3]`; and albedos."""
    m, v = len(materials), len(views)
    index = np.repeat(np.arange(m), v * count)
    view = np.tile(np.repeat(views, count, axis=0), (m, 1))
    numbers = np.tile(qmc.Sobol(3, seed=1).random(count), (m * v, 1))
    samples = probe(materials, index, view, view, numbers)[3]
    values, densities, albedos, _ = probe(materials, index, samples, view, numbers)
    hit = densities > 0
    assert hit.sum() == (samples[:, 2] > 0).sum()
    weights = np.where(hit[:, None], values / np.where(hit, densities, 1)[:, None], 0)
    return (x.reshape(m, v, count, 3).mean(axis=2) for x in (weights, albedos))


def views_at(cosines, turn=0.5):
    c = np.array(cosines)
    s = np.sqrt(1 - c * c)
    return np.stack([s * np.cos(turn), s * np.sin(turn), c], axis=-1)


def test_white_furnace(device):
    """White layers, alone and stacked, at several roughnesses, give all light back, at grazing angles too."""
    stacks = [
        LayeredMaterial(f"{name} {r}", {**WHITE, **inputs, "roughness": r, "coat_roughness": 1 - r})
        for name, inputs in FURNACES.items()
        for r in ROUGHNESSES
    ]
    materials = LayeredSet(*stacks, device=device)
    assert materials.spec == EVERYTHING
    found, albedos = integrals(materials, views_at(COSINES))
    np.testing.assert_allclose(albedos, 1, atol=1e-5)
    np.testing.assert_allclose(found, 1, atol=0.01)


def test_albedo_is_the_integral(device):
    """Of coloured stacks with flat normals, within 1 % of white."""
    inputs = random_inputs(np.random.default_rng(2), 40)
    inputs["normal"] = inputs["coat_normal"] = np.tile([0.0, 0.0, 1.0], (40, 1))
    found, albedos = integrals(LayeredSet(*stacks_of(inputs), device=device), views_at(COSINES))
    np.testing.assert_allclose(found, albedos, atol=0.01)


def test_normal_maps_gain_no_energy(device):
    inputs = random_inputs(np.random.default_rng(4), 40)
    for name in ("color", "dust_color", "coat_color"):
        inputs[name] = np.ones((40, 3))
    found, albedos = integrals(LayeredSet(*stacks_of(inputs), device=device), views_at(COSINES))
    assert found.max() < 1.01 and (found < albedos + 0.01).all() and found.min() > 0.3


def test_reciprocity(device):
    """Diffuse layers alone are reciprocal; stacks, which look at the view's albedo alone, between equal elevations."""
    rng = np.random.default_rng(3)
    rough = rng.random(STACKS)
    diffuse = [
        {"specular": 0.0, "diffuse_roughness": r} if i % 2 else {"dust": 1.0, "dust_roughness": r}
        for i, r in enumerate(rough)
    ]
    stacks = [{"coat": 0.7, "roughness": 0.2 + 0.8 * r, "metalness": 0.5, "coat_color": (r, 1, 0.5)} for r in rough]
    light, view = directions(rng, STACKS), directions(rng, STACKS)
    turned = reference.unit(view * [1, -1, 1] + 0.0)
    for inputs, other in ((diffuse, light), (stacks, turned)):
        materials = [LayeredMaterial(f"{i}", {"color": (0.9, 0.5, 0.1), **given}) for i, given in enumerate(inputs)]
        materials = LayeredSet(*materials, ALL_LAYERS, device=device)
        there = probe(materials, np.arange(STACKS), other, view, 0.5)[0] / other[:, 2:]
        back = probe(materials, np.arange(STACKS), view, other, 0.5)[0] / view[:, 2:]
        np.testing.assert_allclose(there, back, rtol=2e-4)


THETAS, PHIS, SIDE, SAMPLES = 16, 32, 12, 200_000


def expected_counts(materials, index, view):
    """Of samples in each bin of the upper hemisphere `[THETAS * PHIS]`, by quadrature of the density."""
    theta = (np.arange(THETAS * SIDE) + 0.5) / (THETAS * SIDE) * np.pi / 2
    phi = (np.arange(PHIS * SIDE) + 0.5) / (PHIS * SIDE) * 2 * np.pi
    t, p = np.meshgrid(theta, phi, indexing="ij")
    lights = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1).reshape(-1, 3)
    density = probe(materials, index, lights, np.tile(view, (len(lights), 1)), 0.5)[1].reshape(t.shape)
    area = np.pi / 2 / (THETAS * SIDE) * 2 * np.pi / (PHIS * SIDE)
    cells = (density * np.sin(t) * area).reshape(THETAS, SIDE, PHIS, SIDE)
    return SAMPLES * cells.sum(axis=(1, 3)).ravel()


def chi_square(counts, expected):
    """p-value of Pearson's test; bins that expect fewer than 5 are one."""
    few = expected < 5
    pool = [(counts[few].sum(), expected[few].sum())] if expected[few].sum() >= 5 else []
    pairs = np.array([*zip(counts[~few], expected[~few], strict=True), *pool])
    statistic = ((pairs[:, 0] - pairs[:, 1]) ** 2 / pairs[:, 1]).sum()
    return chi2.sf(statistic, len(pairs) - 1)


def test_samples_follow_the_density(device):
    """Chi-square tests over bins of the sphere and one for lost samples, at a level of 1 % for all together (Sidak)."""
    rng = np.random.default_rng(8)
    inputs = random_inputs(rng, 12)
    for name in ("roughness", "coat_roughness"):
        inputs[name] = np.maximum(inputs[name], 0.3)
    for k, name in enumerate(("coat", "dust", "metalness")):  # and lobes alone
        inputs[name][4 * k : 4 * k + 2] = 1.0
    materials = LayeredSet(*stacks_of(inputs), device=device)
    cases = [(index, view) for index in range(12) for view in views_at((0.95, 0.4), turn=1.0 + index)]
    level = 1 - (1 - 0.01) ** (1 / len(cases))
    for index, view in cases:
        samples = probe(materials, index, view, np.tile(view, (SAMPLES, 1)), rng.random((SAMPLES, 3)))[3]
        found = samples[samples[:, 2] > 0]
        np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-5)
        theta, phi = np.arccos(np.minimum(found[:, 2], 1)), np.arctan2(found[:, 1], found[:, 0]) % (2 * np.pi)
        bins = np.minimum(theta / (np.pi / 2) * THETAS, THETAS - 1).astype(int) * PHIS
        bins += np.minimum(phi / (2 * np.pi) * PHIS, PHIS - 1).astype(int)
        counts = np.bincount(bins, minlength=THETAS * PHIS)
        expected = expected_counts(materials, index, view)
        assert expected.sum() < SAMPLES * (1 + 1e-3)
        lost = max(SAMPLES - expected.sum(), 0)
        p = chi_square(np.append(counts, SAMPLES - len(found)), np.append(expected, lost))
        assert p > level, (index, view, p)
