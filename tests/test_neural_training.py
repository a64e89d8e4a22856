"""Training of neural materials: gradients against float64, the same numbers for a seed, and what is learned."""

import json

import numpy as np
import pytest
import warp as wp
from command_line import run
from layered_probe import directions
from neural_probe import probe

from warp_neural import InputError
from warp_neural.kernels.materials import neural_training as kernels
from warp_neural.kernels.materials.neural_spec import LATENTS, NeuralSpec
from warp_neural.kernels.materials.spec import LayeredSpec
from warp_neural.materials.bake import Effort, bake
from warp_neural.materials.layered import LayeredMaterial
from warp_neural.materials.neural import load_neural
from warp_neural.materials.neural_training import new_network

N = 24


def unit(v):
    return v / np.sqrt((v * v).sum(axis=-1, keepdims=True) + 1e-6)


def turned(layer: np.ndarray, latents: np.ndarray, direction: np.ndarray) -> list[np.ndarray]:
    """The direction in both learned frames. layer: weights [12, 8] and biases [12], flat."""
    y = latents @ layer[:96].reshape(12, 8).T + layer[96:]
    found = []
    for first in (0, 6):
        z = unit(y[:, first : first + 3] + [0, 0, 1])
        tangent = y[:, first + 3 : first + 6] + [1, 0, 0]
        x = unit(tangent - z * (z * tangent).sum(axis=-1, keepdims=True))
        rows = np.stack([x, np.cross(z, x), z], axis=1)
        found.append(np.einsum("nij,nj->ni", rows, direction))
    return found


def half_and_difference(light, view):
    half = unit(light + view)
    sine = np.hypot(half[:, 0], half[:, 1])
    x = (half[:, 0] * light[:, 0] + half[:, 1] * light[:, 1]) / sine
    y = (half[:, 0] * light[:, 1] - half[:, 1] * light[:, 0]) / sine
    difference = np.stack([half[:, 2] * x - sine * light[:, 2], y, sine * x + half[:, 2] * light[:, 2]], axis=-1)
    return [half, difference]


def reference_loss(spec, parameters, layer, latents, light, view, target):
    """Of each pair, in float64."""
    pair = half_and_difference if spec.directions == "half_difference" else lambda *both: both
    pairs = (
        [(light, view)] if not spec.frames else zip(*(turned(layer, latents, d) for d in (light, view)), strict=True)
    )
    h = np.concatenate([latents, *(x for both in pairs for x in pair(*both))], axis=-1)
    start, layers = 0, spec.decoder.layers
    for i, (k, n) in enumerate(layers):
        weights, biases = parameters[start : start + n * k].reshape(n, k), parameters[start + n * k :][:n]
        h = h @ weights.T + biases
        h = h if i == len(layers) - 1 else np.where(h > 0, h, 0.01 * h)
        start += n * k + n
    return np.abs(np.log(0.02 + np.exp(h - 3)) - np.log(0.02 + target)).mean(axis=-1)


def differences(function, x):
    """The gradient of a sum, by central differences."""
    gradient = np.zeros_like(x)
    for i in range(x.size):
        ends = []
        for step in (1e-6, -1e-6):
            moved = x.copy()
            moved.flat[i] += step
            ends.append(function(moved).sum())
        gradient.flat[i] = (ends[0] - ends[1]) / 2e-6
    return gradient


@pytest.mark.parametrize("directions_as", ["half_difference", "light_view"])
@pytest.mark.parametrize("frames", [0, 2])
def test_gradients_of_the_decoder(device, frames, directions_as):
    """Of its parameters, the frame layer's and the latents, through `net.func` and the frames."""
    spec, rng = NeuralSpec(2, 20, frames, "float32", directions_as), np.random.default_rng(1)
    nets = {name: new_network(each, 3, device) for name, each in spec.networks.items()}
    light, view, latents = directions(rng, N), directions(rng, N), np.float32(rng.normal(size=(N, LATENTS)))
    draws = kernels.Draws()
    target = np.float32(rng.choice([0.001, 3.0], (N, 3)))
    for name, values in (("light", light), ("view", view), ("target", target)):
        setattr(draws, name, wp.array(values, dtype=wp.vec3, device=device))
    held = wp.array(latents, dtype=kernels.vec_latents, device=device, requires_grad=True)
    loss, ones = wp.zeros(N, dtype=float, device=device), wp.ones(N, dtype=float, device=device)
    params = [nets["decoder"].params, nets["frames"].params]
    kernel, inputs = kernels.make_loss_kernel(spec, 1), [*params, held, draws]
    wp.launch(kernel, N, inputs, [loss], device=device)
    adjoints = {"adj_inputs": [*params, held.grad, kernels.Draws()], "adj_outputs": [ones]}
    wp.launch(kernel, N, inputs, [loss], adjoint=True, device=device, **adjoints)

    masters = [nets[name].master.numpy()[: nets[name].n_parameters].astype(float) for name in ("decoder", "frames")]
    given = [*masters, latents.astype(float)]

    def loss_of(i, x):
        values = [x if k == i else value for k, value in enumerate(given)]
        return reference_loss(spec, *values, light, view, target.astype(float))

    np.testing.assert_allclose(loss.numpy(), loss_of(0, given[0]), rtol=1e-4)
    found = [nets[name].gradient.numpy()[: nets[name].n_parameters] for name in ("decoder", "frames")]
    for i, gradient in enumerate([*found, held.grad.numpy()]):
        expected = differences(lambda x, i=i: loss_of(i, x), given[i])
        assert (np.abs(expected).max() > 0.01) == (i != 1 or frames > 0)
        np.testing.assert_allclose(gradient, expected, atol=1e-3 * max(np.abs(expected).max(), 1e-3))


TOY = Effort(8, 120, 60, 32)


def checkers(side: int = 8) -> LayeredMaterial:
    rows = np.arange(side)
    board = ((rows[:, None] // 2 + rows // 2) % 2).astype(np.float32)
    color = board[..., None] * [0.7, 0.2, 0.1] + 0.1
    return LayeredMaterial("checkers", {"color": np.float32(color), "roughness": 0.3 + 0.4 * board, "metalness": board})


def test_the_same_for_a_seed(device):
    first, second, other = (bake(checkers(), effort=TOY, seed=seed, device=device) for seed in (5, 5, 6))
    if not device.is_cuda:  # there sums are in any order
        for name, network in first.states[0].networks.items():
            np.testing.assert_array_equal(network.parameters, second.states[0].networks[name].parameters)
        for a, b in zip(first.states[0].codes, second.states[0].codes, strict=True):
            np.testing.assert_array_equal(a, b)
    assert (first.states[0].codes[0] != other.states[0].codes[0]).any()


def test_a_metal_is_learned(device):
    """Values, albedo, and a sampler whose estimates of the albedo vary far less than a cosine's."""
    metal = LayeredMaterial("metal", {"metalness": 1.0, "roughness": 0.35, "color": (0.9, 0.6, 0.3)})
    neural = bake(metal, effort=Effort(1, 1200, 1200, 64), seed=1, device=device)
    assert neural.states[0].metrics["error"] < 0.05
    rng, n, view = np.random.default_rng(2), 20_000, (0.6, 0.0, 0.8)
    u = rng.random((n, 3))
    samples = probe(neural, 0, (0.5, 0.5, 0), view, np.tile(view, (n, 1)), u)[3]
    values, densities, albedos, _ = probe(neural, 0, (0.5, 0.5, 0), samples, np.tile(view, (n, 1)), 0.5)
    own = values[:, 0] / densities
    sine = np.sqrt(u[:, 1])
    cosine = np.stack(
        [sine * np.cos(2 * np.pi * u[:, 0]), sine * np.sin(2 * np.pi * u[:, 0]), np.sqrt(1 - u[:, 1])], -1
    )
    plain = probe(neural, 0, (0.5, 0.5, 0), cosine, np.tile(view, (n, 1)), 0.5)[0][:, 0] * np.pi / cosine[:, 2]
    assert own.mean() == pytest.approx(plain.mean(), rel=0.06) and own.std() < 0.5 * plain.std()
    np.testing.assert_allclose(albedos[0], [0.9, 0.62, 0.34], atol=0.06)
    assert own.mean() == pytest.approx(albedos[0, 0], abs=0.1)


def test_the_command_bakes(tmp_path, capfd):
    found = run(
        capfd, "bake", "deluxe", "-o", str(tmp_path / "d.wnm"), "--side", "16", "--steps", "16", "--preview", *CPU
    )
    assert found["decoder"] == "2x32, 2 frames, float16" and found["mips"] == 5 and found["source"] == "deluxe"
    assert 0 < found["metrics"]["error"] < 1 and json.dumps(load_neural(tmp_path / "d.wnm").states[0].metrics)


CPU = "--device", "cpu"


def test_arguments_that_make_no_sense():
    with pytest.raises(InputError, match="way='guess': give one of texture, encoder"):
        bake(checkers(), way="guess", device="cpu")
    with pytest.raises(InputError, match="frames=1: expected 0 or 2"):
        NeuralSpec(frames=1)
    with pytest.raises(InputError, match="side=0: expected a whole number"):
        Effort(0, 10, 10, 10)


def test_training_compiles_for_hopper(tmp_path):
    spec, layered = NeuralSpec(), LayeredSpec(coat=True)
    made = [kernels.make_draw_kernel(layered, 2, True), kernels.make_loss_kernel(spec, 2), kernels.read_kernel]
    made += [kernels.make_sampler_loss_kernel(spec, 2), kernels.make_encode_kernel(), kernels.make_bake_kernel(layered)]
    for kernel in made:
        (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path / kernel.key)
        assert artifact.stat().st_size > 0
