"""The Disney terms, how samples of them are drawn and networks judged, and every main at toy size."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import reference
import reference_disney
import warp as wp

import warp_neural as wn
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image, save_image
from warp_neural.kernels.training.fused import make_gradient_kernel
from warp_neural.kernels.training.mma.schedule import make_schedule
from warp_neural.samples.shader_training import __main__ as shader_training
from warp_neural.samples.shader_training import (
    step_01_simple_inferencing,
    step_02_simple_training,
    step_03_model_exploration,
)
from warp_neural.samples.shader_training.disney import disney_terms, draw, vec5
from warp_neural.samples.shader_training.evaluate import evaluate, make_error_kernel
from warp_neural.samples.shader_training.train import LOSS, make_net


@wp.kernel(enable_backward=False)
def draw_kernel(seed: wp.uint64, xs: wp.array[vec5], terms: wp.array[wp.vec4]):
    i = wp.tid()
    x, t = draw(i, wn.random.stream(seed, 0, i, wn.random.HELD_OUT))
    xs[i] = x
    terms[i] = t


@wp.func
def exact(params: wn.MLP.Params, x: vec5) -> wp.vec4:
    return disney_terms(x)


@wp.func
def doubled(params: wn.MLP.Params, x: vec5) -> wp.vec4:
    return 2.0 * disney_terms(x)


loss_value, loss_gradient = LOSS.value(4), LOSS.gradient(4)


@wp.kernel(enable_backward=False)
def loss_kernel(p: wp.array[wp.vec4], t: wp.array[wp.vec4], gradients: wp.array[wp.vec4], values: wp.array[float]):
    i = wp.tid()
    values[i] = loss_value(p[i], t[i])
    gradients[i] = loss_gradient(p[i], t[i])


@pytest.fixture(scope="module")
def drawn(device):
    xs, terms = wp.empty(50000, dtype=vec5, device=device), wp.empty(50000, dtype=wp.vec4, device=device)
    wp.launch(draw_kernel, dim=50000, inputs=[3, xs, terms], device=device)
    return xs.numpy(), terms.numpy()


@pytest.fixture
def common(device, tmp_path):
    return {"device": device.alias, "out": tmp_path, "json": True}


def test_terms_against_float64(drawn):
    xs, terms = drawn
    np.testing.assert_allclose(terms, reference_disney.disney_terms(xs), rtol=1e-5, atol=1e-7)


def test_samples_are_uniform_in_angle(drawn):
    nl, nv, nh, lh, roughness = drawn[0].astype(np.float64).T
    quarters = np.linspace(0, 1, 5)[1:4]
    for uniform in (np.arcsin(nl) / (np.pi / 2), np.arcsin(nv) / (np.pi / 2), (roughness - 0.3) / 0.7):
        assert 0 <= uniform.min() < 1e-3 and 0.999 < uniform.max() <= 1 + 1e-6
        np.testing.assert_allclose(np.quantile(uniform, quarters), quarters, atol=0.01)
    assert 0 <= nh.min() and nh.max() <= 1 and 0 <= lh.min() and lh.max() <= 1
    # N.H and L.H give the azimuth between light and view back: |l + v| = 2 L.H, of which the normal sees N.L + N.V
    length = 2 * lh
    np.testing.assert_allclose(nh * length, nl + nv, atol=1e-3)
    sines = np.sqrt((1 - nl**2) * (1 - nv**2))
    inside = sines > 0.1
    cosine = (length**2 / 2 - 1 - nl * nv)[inside] / sines[inside]
    azimuth = np.arccos(np.clip(cosine, -1, 1)) / np.pi
    np.testing.assert_allclose(np.quantile(azimuth, quarters), quarters, atol=0.015)


def test_exact_predictions_have_no_error(device, drawn):
    errors = {}
    for func in (exact, doubled):
        net = SimpleNamespace(func=func, params=wn.MLP.Params(), device=device)
        errors[func] = evaluate(net, samples=50000, seed=3)
    assert errors[exact]["relative_error"] == errors[exact]["relative_error_median"] == 0
    assert errors[exact]["relative_error_per_term"] == [0] * 4
    assert errors[doubled]["relative_error"] == pytest.approx(1) == errors[doubled]["relative_error_median"]
    by_term = (drawn[1] / (drawn[1] + 0.01)).mean(axis=0)
    np.testing.assert_allclose(errors[doubled]["relative_error_per_term"], by_term, rtol=1e-4)


def test_errors_of_a_network_against_float64(device, drawn):
    """Of a fresh network, both as the device counts them and from its own outputs."""
    net = make_net(device, seed=1)
    errors = evaluate(net, samples=50000, seed=3)
    terms = reference_disney.disney_terms(drawn[0])
    y = predictions(net, drawn[0])
    relative = np.linalg.norm(y - terms, axis=1) / np.linalg.norm(terms, axis=1)
    assert errors["relative_error"] == pytest.approx(relative.mean(), rel=1e-4)
    assert errors["relative_error_median"] == pytest.approx(np.median(relative), rel=1e-4)
    by_term = (np.abs(y - terms) / (np.abs(terms) + 0.01)).mean(axis=0)
    np.testing.assert_allclose(errors["relative_error_per_term"], by_term, rtol=1e-4)


def test_loss_against_float64(device):
    """And its gradient."""
    rng = np.random.default_rng(2)
    t = np.exp(rng.uniform(-5, 3, (200, 4)))
    p = t * np.exp(rng.normal(0, 1, t.shape) * rng.choice([0.001, 0.01, 1], t.shape))
    p, t = (a.astype(np.float32).astype(np.float64) for a in (p, t))
    arrays = [wp.array(a, dtype=wp.vec4, device=device) for a in (p, t, 0 * t)]
    values = wp.zeros(len(t), dtype=float, device=device)
    wp.launch(loss_kernel, dim=len(t), inputs=[*arrays, values], device=device)

    def loss(q):  # denominators stay those of p
        terms = LOSS.weights * np.sqrt((q - t) ** 2 + (0.005 * (p + 0.01)) ** 2) / (p + 0.01)
        size = (t**2).sum(axis=1)
        return terms.sum(axis=1) + np.sqrt(((q - t) ** 2).sum(axis=1) / size + 0.005**2)

    np.testing.assert_allclose(values.numpy(), loss(p), rtol=1e-5)
    slopes = reference.derivative(loss, p)
    np.testing.assert_allclose(arrays[2].numpy() * t, slopes * t, rtol=1e-5, atol=1e-6)


def predictions(net, xs):
    """In float64, of a float16 network's weights: 30-32-32-32-4 with 3 octaves of each input."""
    angles = np.pi * xs.astype(np.float64)[..., None] * [1, 2, 4]
    h = np.stack([np.sin(angles), np.cos(angles)], axis=-1).reshape(len(xs), 30)
    for layer, (w, b) in enumerate(zip(net.weights, net.biases, strict=True)):
        h = h.astype(np.float16).astype(np.float64) @ w.astype(np.float16).astype(np.float64).T + b
        h = np.exp(h) if layer == 3 else np.maximum(h, 0)
    return h


def test_shader_training(common, tmp_path):
    toy = {**common, "size": 64, "samples": 20000}
    metrics = shader_training.main(shader_training.Config(**toy, epochs=4, batch=512))
    assert 0 < metrics["relative_error_median"] < metrics["relative_error"] < 0.2
    assert len(metrics["relative_error_per_term"]) == 4 and metrics["seconds_train"] > 0
    assert (metrics["samples"], metrics["parameters"]) == (20000, 3236)
    assert json.loads((tmp_path / "metrics.json").read_text()) == json.loads(json.dumps(metrics))
    for name in ("spheres.png", "sheet.png"):
        assert load_image(tmp_path / name).std() > 0.05
    for name in ("network.safetensors", "network.ns.bin", "network.json"):
        loaded = shader_training.main(shader_training.Config(**toy, network=tmp_path / name))
        assert loaded["seconds_train"] == 0
        if name == "network.safetensors":
            assert loaded["relative_error"] == metrics["relative_error"]
        assert loaded["relative_error"] == pytest.approx(metrics["relative_error"], rel=1e-3)

    step = step_01_simple_inferencing.main(
        step_01_simple_inferencing.Config(**common, size=64, network=tmp_path / "network.ns.bin")
    )
    assert step["psnr"] == pytest.approx(metrics["psnr_sphere"], abs=3) and step["psnr"] > 20
    picture = load_image(tmp_path / "step_01.png")
    assert picture.shape == (64, 128, 3) and picture.std() > 0.05


def test_compiles_for_hopper(tmp_path):
    net = make_net("cpu", seed=0)
    kernels = [
        make_gradient_kernel(net.spec, make_schedule(net.spec), draw, LOSS, net.plain_encode),
        make_error_kernel(net.func),
    ]
    kernels.append(step_01_simple_inferencing.make_shade_kernel(net.func))
    for kernel in kernels:
        (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path / kernel.key)
        assert artifact.stat().st_size > 0


def test_simple_inferencing_trains_its_own(common, tmp_path):
    config = step_01_simple_inferencing.Config(**common, size=48, epochs=3)
    assert step_01_simple_inferencing.main(config)["psnr"] > 20
    assert wn.load_network(tmp_path / "small.safetensors").n_in == 5


def test_simple_training(common, tmp_path):
    rng = np.random.default_rng(0)
    blocks = np.kron(rng.uniform(0.1, 0.9, (3, 3, 3)), np.ones((16, 16, 1)))
    save_image(tmp_path / "blocks.png", blocks)
    config = step_02_simple_training.Config(**common, image=tmp_path / "blocks.png", steps=200)
    assert step_02_simple_training.main(config)["psnr"] > 16
    image, truth, fit, _error = np.split(load_image(tmp_path / "step_02.png"), 4, axis=1)
    assert image.shape == (48, 48, 3) and np.abs(image - truth).mean() > 0.05 > np.abs(fit - truth).mean()


def test_a_turn_by_90_degrees_is_exact(common, tmp_path):
    """Clockwise: what was at the top is at the right."""
    image = np.random.default_rng(1).uniform(0.1, 0.9, (16, 16, 3))
    save_image(tmp_path / "noise.png", image)
    config = step_02_simple_training.Config(**common, image=tmp_path / "noise.png", steps=1, degrees=90, scale=1)
    step_02_simple_training.main(config)
    original, truth, *_ = np.split(load_image(tmp_path / "step_02.png"), 4, axis=1)
    np.testing.assert_allclose(truth, np.rot90(original, -1), atol=0.01)


def test_model_exploration(common, tmp_path):
    metrics = step_03_model_exploration.main(step_03_model_exploration.Config(**common, size=64, steps=200))
    networks = metrics["networks"]
    assert len(networks) == 4 and networks["plain 3x32"]["psnr"] == min(net["psnr"] for net in networks.values())
    assert networks["ours: fine and coarse"]["parameters"] < networks["latent texture"]["parameters"]
    assert load_image(tmp_path / "step_03.png").std() > 0.05
    kept = wn.load_network(tmp_path / "step_03.safetensors")
    assert kept.master.size == networks[metrics["best"]]["parameters"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"roughness": 0.1}, "--roughness 0.1"),
        ({"base_color": (0.0, 2.0, 0.0)}, "--base-color"),
        ({"metallic": -1.0}, "--metallic -1.0"),
        ({"light": (0.0, 0.0, 0.0)}, "--light"),
        ({"epochs": 0}, "--epochs 0"),
        ({"samples": -5}, "--samples -5"),
    ],
)
def test_bad_options(tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        shader_training.main(shader_training.Config(**{"device": "cpu", "out": tmp_path, **options}))


def test_another_network_is_refused(tmp_path):
    wn.save_network(tmp_path / "other.safetensors", wn.MLP(5, 3, device="cpu"))
    config = shader_training.Config(device="cpu", out=tmp_path, network=tmp_path / "other.safetensors")
    with pytest.raises(InputError, match="5 inputs and 3 outputs"):
        shader_training.main(config)


@pytest.mark.parametrize("step", [step_02_simple_training, step_03_model_exploration])
def test_bad_steps(tmp_path, step):
    with pytest.raises(InputError, match="--steps 0"):
        step.main(step.Config(device="cpu", out=tmp_path, steps=0))
