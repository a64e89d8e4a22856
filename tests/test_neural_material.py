"""Neural materials for renderers: values, densities, samples, files, sets, and no numbers that are none."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from command_line import refused, run
from layered_probe import directions
from neural_probe import make_probe_kernel, probe, random_state
from scipy.stats import chi2

from warp_neural import InputError
from warp_neural.io.tensors import load_tensors, save_tensors
from warp_neural.kernels.materials.neural_spec import NeuralSpec
from warp_neural.materials.neural import NeuralMaterial, load_neural

SPEC = NeuralSpec()
PLACE = (0.3, 0.6, 0.0)


def hemisphere(thetas: int, phis: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions of a midpoint rule, [thetas * phis, 3], and their solid angles; denser towards the horizon's end."""
    theta, phi = (np.arange(thetas) + 0.5) / thetas * np.pi / 2, (np.arange(phis) + 0.5) / phis * 2 * np.pi
    t, p = (x.ravel() for x in np.meshgrid(theta, phi, indexing="ij"))
    lights = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    return lights, np.sin(t) * (np.pi / 2 / thetas) * (2 * np.pi / phis)


def test_the_density_integrates_to_one(device):
    """Of random materials, places and views, by a rule that is finer than the narrowest lobe."""
    rng = np.random.default_rng(3)
    material = NeuralMaterial(*(random_state(SPEC, seed) for seed in range(4)), device=device)
    lights, areas = hemisphere(512, 1024)
    for i, view in enumerate(directions(rng, 24, 0.02)):
        place = (*rng.random(2), i % 3)
        density = probe(material, i % 4, place, lights, view, 0.5)[1]
        assert density @ areas == pytest.approx(1, abs=1e-3)


def test_samples_follow_the_density(device):
    """Chi-square tests at a level of 1 % for all together (Sidak); bins of the sphere, some of them pooled."""
    rng, n, bins = np.random.default_rng(4), 100_000, (16, 32)
    material = NeuralMaterial(*(random_state(SPEC, seed) for seed in range(2)), device=device)
    lights, areas = hemisphere(bins[0] * 16, bins[1] * 16)
    views = directions(rng, 8, 0.05)
    for i, view in enumerate(views):
        samples = probe(material, i % 2, PLACE, np.tile(view, (n, 1)), view, rng.random((n, 3)))[3]
        np.testing.assert_allclose(np.linalg.norm(samples, axis=-1), 1, atol=1e-5)
        assert (samples[:, 2] > 0).all()
        mass = (probe(material, i % 2, PLACE, lights, view, 0.5)[1] * areas).reshape(bins[0], 16, bins[1], 16)
        expected = n * mass.sum(axis=(1, 3)).ravel()
        theta, phi = np.arccos(np.minimum(samples[:, 2], 1)), np.arctan2(samples[:, 1], samples[:, 0]) % (2 * np.pi)
        at = np.minimum(theta / (np.pi / 2) * bins[0], bins[0] - 1).astype(int) * bins[1]
        at += np.minimum(phi / (2 * np.pi) * bins[1], bins[1] - 1).astype(int)
        counts = np.bincount(at, minlength=expected.size)
        few = expected < 5
        pairs = np.array([*zip(counts[~few], expected[~few], strict=True), (counts[few].sum(), expected[few].sum())])
        statistic = ((pairs[:, 0] - pairs[:, 1]) ** 2 / np.maximum(pairs[:, 1], 1e-3)).sum()
        assert chi2.sf(statistic, len(pairs) - 1) > 1 - 0.99 ** (1 / len(views))


def test_a_set_calls_each_material_as_it_is_alone(device):
    """With different materials in one warp; sets of one are the measure, bit for bit but on CUDA: the last
    threads there are no whole warp, and sum in another order than tensor cores do."""
    rng, n = np.random.default_rng(5), 512
    states = [random_state(SPEC, seed, side=4 << seed) for seed in range(3)]
    index, places = rng.integers(0, 3, n), np.column_stack([rng.uniform(-2, 2, (n, 2)), rng.uniform(-1, 6, n)])
    lights, views, numbers = directions(rng, n), directions(rng, n), rng.random((n, 3))
    together = probe(NeuralMaterial(*states, device=device), index, places, lights, views, numbers)
    for i, state in enumerate(states):
        mine = index == i
        alone = NeuralMaterial(state, device=device)
        found = probe(alone, 0, *(x[mine] for x in (places, lights, views, numbers)))
        for a, b in zip(found, together, strict=True):
            np.testing.assert_allclose(a, b[mine], rtol=1e-5 if device.is_cuda else 0, atol=0)
            assert a.std() > 0


@pytest.mark.parametrize("frames", [0, 2])
@pytest.mark.parametrize("scale", [0.0, 1.0, 30.0])
def test_no_input_gives_nan(device, frames, scale):
    """Grazing and opposite directions, those on and below the horizon, places and levels that are none."""
    rng, n = np.random.default_rng(6), 2000
    material = NeuralMaterial(random_state(NeuralSpec(frames=frames), 1, scale=scale), device=device)
    lights, views = directions(rng, n), directions(rng, n)
    lights[:300, 2] *= rng.choice([0.0, 1e-7, -1.0], 300)
    views[200:600, 2] *= rng.choice([0.0, 1e-7, -1.0], 400)
    lights[600:700], views[700:800] = views[600:700], [0, 0, 1]
    lights[800:900] = views[800:900] * [-1, -1, 1]
    places = np.column_stack([rng.normal(0, 1e3, (n, 2)), rng.normal(0, 100, n)])
    numbers = rng.choice([0.0, 0.5, 1 - 2**-24], (n, 3))
    values, densities, albedos, samples = probe(material, 0, places, lights, views, numbers)
    for found in (values, densities, albedos, samples):
        assert np.isfinite(found).all()
    above, seen = (lights[:, 2] > 0) & (views[:, 2] > 0), views[:, 2] > 0
    assert (values[~above] == 0).all() and (densities[~above] == 0).all() and (values >= 0).all()
    assert (densities[above] > 0).all() and (samples[seen, 2] > 0).all() and (samples[~seen] == 0).all()
    assert (albedos >= 0).all() and (albedos <= 1).all() and (albedos[~seen] == 0).all()


def test_compiles_for_hopper(tmp_path):
    (artifact,) = wp.compile_aot_module(make_probe_kernel(SPEC).module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_files_return_equal(device, tmp_path):
    rng = np.random.default_rng(7)
    for spec in (SPEC, NeuralSpec(3, 64, 0, "float32")):
        first = NeuralMaterial(random_state(spec, 2, side=16), device=device)
        first.save(tmp_path / "one.wnm")
        second = load_neural(tmp_path / "one.wnm", device=device)
        assert (
            second.spec == spec and second.states[0].source == "random 2" and second.states[0].metrics["error"] == 0.5
        )
        arguments = (0, PLACE, directions(rng, 50), directions(rng, 50), 0.3)
        for a, b in zip(probe(first, *arguments), probe(second, *arguments), strict=True):
            np.testing.assert_array_equal(a, b)
    with pytest.raises(InputError, match="a file holds one neural material, and this is a set of 2"):
        NeuralMaterial(random_state(SPEC, 0), random_state(SPEC, 1), device=device).save(tmp_path / "two.wnm")
    assert not (tmp_path / "two.wnm").exists()
    with pytest.raises(InputError, match="a set has one kind"):
        NeuralMaterial(random_state(SPEC, 0), random_state(replace(SPEC, width=16), 1), device=device)


DAMAGES = {
    "version": (lambda t, m: m.update(version=7), "version '7', and this reads 1"),
    "format": (lambda t, m: m.update(format="network"), "format 'network', not a neural material"),
    "field": (lambda t, m: m.pop("source"), r"metadata \['source'\] is missing or unknown"),
    "type": (lambda t, m: m.update(levels="4"), "levels '4' is not of type int"),
    "spec": (lambda t, m: m["spec"].update(frames=5), "spec: frames=5"),
    "depth": (lambda t, m: m["spec"].update(depth="two"), "spec: depth='two'"),
    "other spec": (lambda t, m: m["spec"].update(width=16), "decoder is .*, not what 2x16"),
    "network": (lambda t, m: m["networks"].pop("sampler"), "networks: no sampler"),
    "weights": (lambda t, m: t.pop("decoder.weights.1"), "decoder: tensor 'weights.1' is missing"),
    "nan": (lambda t, m: t["frames.biases.0"].fill(np.nan), "frames: tensor 'biases.0' holds NaN"),
    "level": (lambda t, m: t.update({"latents.1": t["latents.0"]}), r"tensor 'latents.1' is uint8 \[8, 8, 8\]"),
    "levels": (lambda t, m: m.update(levels=40), "tensor 'latents.0' or levels 40"),
    "scale": (lambda t, m: t["scale"].fill(np.inf), "tensor 'scale' holds NaN or infinite"),
    "unknown": (lambda t, m: t.update(more=np.zeros(3)), "unknown tensors 'more'"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_files_are_refused_by_name(damage, tmp_path):
    change, message = DAMAGES[damage]
    path = tmp_path / "damaged.wnm"
    NeuralMaterial(random_state(SPEC, 0), device="cpu").save(path)
    tensors, metadata = load_tensors(path)
    change(tensors, metadata)
    save_tensors(path, tensors, metadata)
    with pytest.raises(InputError, match=message) as error:
        load_neural(path, device="cpu")
    assert "\n" not in str(error.value) and str(path) in str(error.value)


def test_files_cut_short_are_refused(tmp_path):
    path = tmp_path / "short.wnm"
    NeuralMaterial(random_state(SPEC, 0), device="cpu").save(path)
    whole = path.read_bytes()
    for length in (0, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match="not a whole safetensors file"):
            load_neural(path, device="cpu")


def test_the_command_says_what_a_file_is(tmp_path, capfd):
    path = tmp_path / "random.wnm"
    NeuralMaterial(random_state(SPEC, 3), device="cpu").save(path)
    found = run(capfd, "info", str(path))
    assert found["format"] == "neural_material" and found["source"] == "random 3" and found["mips"] == 4
    assert found["networks"]["decoder"] == [20, 32, 32, 3] and found["bytes"] == path.stat().st_size
    assert "name it .wnm" in refused(capfd, "bake", "deluxe", "-o", str(tmp_path / "material.bin"))
