"""Every loss against float64, its derivative too, and its taped against its direct one."""

from functools import cache

import numpy as np
import pytest
import reference
import reference_losses
import warp as wp

from warp_neural import InputError
from warp_neural.kernels.nn import losses
from warp_neural.kernels.nn.losses import Loss

LOSSES = (*losses.ALL, losses.huber(0.25))


def weighted(loss: Loss, n: int) -> Loss:
    return loss.weighted(*np.linspace(0.0, 2.0, n)) if n > 1 else loss


@cache
def make_kernels(n: int) -> tuple[wp.Kernel, wp.Kernel]:
    """All losses in one module: values for the tape, and gradients."""
    vec = wp.types.vector(n, float)
    values = [weighted(loss, n).value(n) for loss in LOSSES]
    gradients = [weighted(loss, n).gradient(n) for loss in LOSSES]

    @wp.kernel(module="unique")
    def value_kernel(p: wp.array2d[vec], t: wp.array[vec], y: wp.array2d[float]):
        i = wp.tid()
        for k in range(wp.static(len(values))):
            y[k, i] = wp.static(values[k])(p[k, i], t[i])

    @wp.kernel(module="unique", enable_backward=False)
    def gradient_kernel(p: wp.array2d[vec], t: wp.array[vec], d: wp.array2d[vec]):
        i = wp.tid()
        for k in range(wp.static(len(gradients))):
            d[k, i] = wp.static(gradients[k])(p[k, i], t[i])

    return value_kernel, gradient_kernel


def evaluate(p: np.ndarray, t: np.ndarray, device: wp.Device) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each loss and sample: value, direct gradient, and taped one times (1, 2, ...)."""
    samples, n = p.shape
    vec, shape = wp.types.vector(n, float), (len(LOSSES), samples)
    predictions = wp.array(np.broadcast_to(p, (*shape, n)), dtype=vec, device=device, requires_grad=True)
    targets = wp.array(t, dtype=vec, device=device)
    y = wp.zeros(shape, dtype=float, device=device, requires_grad=True)
    d = wp.zeros(shape, dtype=vec, device=device)
    value_kernel, gradient_kernel = make_kernels(n)
    with wp.Tape() as tape:
        wp.launch(value_kernel, samples, [predictions, targets, y], device=device)
    wp.launch(gradient_kernel, samples, [predictions, targets, d], device=device)
    y.grad.assign(np.broadcast_to(np.arange(1, samples + 1, dtype=np.float32), shape))
    tape.backward()
    return y.numpy(), d.numpy(), predictions.grad.numpy()


def draw(n):
    """Predictions and targets, `[100, n]`."""
    rng = np.random.default_rng(0)
    p = rng.uniform(-0.5, 3, (100, n)).astype(np.float32)
    return p, (rng.dirichlet(np.ones(n), 100) if n > 1 else rng.uniform(0, 1, (100, 1))).astype(np.float32)


@pytest.mark.parametrize("n", [1, 3])
def test_gradients_of_the_reference(n):
    p, t = (a.astype(np.float64) for a in draw(n))
    for loss in LOSSES:
        loss = weighted(loss, n)
        stepped = reference.derivative(lambda q: reference_losses.value(loss, q, t, p), p)  # noqa: B023
        np.testing.assert_allclose(reference_losses.gradient(loss, p, t), stepped, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("n", [1, 3, 20])
def test_losses(n, device):
    p, t = draw(n)
    values, gradients, taped = evaluate(p, t, device)
    p, t = p.astype(np.float64), t.astype(np.float64)
    for loss, y, d, tape in zip(LOSSES, values, gradients, taped, strict=True):
        loss = weighted(loss, n)
        exact = reference_losses.value(loss, p, t)
        np.testing.assert_allclose(y, exact, rtol=2e-6, atol=2e-7, err_msg=loss.name)
        slope = reference_losses.gradient(loss, p, t)
        np.testing.assert_allclose(d, slope, rtol=4e-6, atol=4e-7 * np.abs(slope).max(), err_msg=loss.name)
        np.testing.assert_allclose(tape, d * np.arange(1, 101)[:, None], rtol=1e-5, atol=1e-6, err_msg=loss.name)


def test_equal_vectors_have_no_loss(device):
    p = np.random.default_rng(0).uniform(0.1, 1, (10, 3)).astype(np.float32)
    for loss, y, d in zip(LOSSES, *evaluate(p, p, device)[:2], strict=True):
        assert loss.name == "cross_entropy" or (not y.any() and not d.any()), loss.name


def test_not_finite_shows_in_the_gradient(device):
    """So that a training step can skip it: the loss of a bad sample never looks like a good one."""
    p = np.ones((2, 3), np.float32)
    t = np.array([[0.1, np.nan, 0.2], [np.inf, 0.1, 0.2]], np.float32)
    for loss, y, d in zip(LOSSES, *evaluate(p, t, device)[:2], strict=True):
        if "huber" not in loss.name and loss.name not in ("l1", "mape", "smape", "relative_l1"):
            assert not np.isfinite(y).any(), loss.name
        assert not np.isfinite(d[0]).all() and not np.isfinite(d[1]).all(), loss.name


def test_large_logits_and_dead_predictions_stay_finite(device):
    p = np.array([[200.0, -200.0, 0.0], [-1.0, 0.0, 1e-30]], np.float32)
    t = np.array([[0.0, 1.0, 0.0], [0.5, 0.5, 0.5]], np.float32)
    values, gradients, _ = evaluate(p, t, device)
    at = [loss.name for loss in LOSSES]
    k = at.index("cross_entropy")
    np.testing.assert_allclose([*values[k, :1], *gradients[k, 0]], [400, 1, -1, 0], rtol=1e-6)
    gamma = gradients[at.index("gamma_l2"), 1]
    assert gamma[:2].tolist() == [0, 0] and np.isfinite(gamma[2]) and gamma[2] < 0


def test_bad_arguments():
    for make, message in [
        (lambda: losses.huber(0.0), "positive"),
        (lambda: losses.l2.weighted(1.0, -1.0), "not negative"),
        (lambda: losses.l2.weighted(float("nan")), "not negative"),
        (lambda: losses.l2.weighted(1.0, 2.0).value(3), "2 weights for 3"),
        (lambda: losses.huber("one"), "delta='one': expected a positive number"),
        (lambda: losses.l2.weighted(None), "expected finite numbers"),
        (lambda: losses.l2.value(0), "n=0: expected a whole number"),
    ]:
        with pytest.raises(InputError, match=message):
            make()


def test_compiles_for_hopper(tmp_path):
    for kernel in make_kernels(3):
        (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
        assert artifact.stat().st_size > 0
