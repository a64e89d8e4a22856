"""Every activation, its derivative and its adjoint against float64."""

import pickle

import numpy as np
import pytest
import reference_networks as reference
import warp as wp

from warp_neural.kernels.nn import activations

NAMES = [a.name for a in activations.ALL]
VALUES, SLOPES = [a.func for a in activations.ALL], [a.slope for a in activations.ALL]


@wp.kernel(module="unique")
def value_kernel(z: wp.array[float], y: wp.array2d[float]):
    i = wp.tid()
    for a in range(wp.static(len(NAMES))):
        y[a, i] = wp.static(VALUES[a])(z[i])


@wp.kernel(module="unique", enable_backward=False)
def slope_kernel(z: wp.array[float], y: wp.array2d[float]):
    i = wp.tid()
    for a in range(wp.static(len(NAMES))):
        y[a, i] = wp.static(SLOPES[a])(z[i])


def points():
    return np.linspace(-8, 8, 1000).astype(np.float32)  # not 0, where ReLU has no derivative


def launch(kernel, device):
    z = wp.array(points(), dtype=float, device=device, requires_grad=True)
    y = wp.zeros((len(NAMES), len(z)), dtype=float, device=device, requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(kernel, len(z), [z], [y], device=device)
    return z, y, tape


def tolerance(expected):
    """A few units in the last place of float32; near zero, of the terms that cancel there (squareplus, GELU)."""
    return 4e-6 * np.maximum(np.abs(expected), 1)


@pytest.mark.parametrize("name", NAMES)
def test_slopes_of_the_reference(name):
    """Against those that a step into the complex plane shows, where nothing cancels."""
    f, z = reference.ACTIVATIONS[name], points().astype(np.float64)
    np.testing.assert_allclose(f.slope(z), f(z + 1e-30j).imag / 1e-30, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("name", NAMES)
def test_value(name, device):
    y = launch(value_kernel, device)[1].numpy()[NAMES.index(name)]
    expected = reference.ACTIVATIONS[name](points().astype(np.float64))
    assert (np.abs(y - expected) <= tolerance(expected)).all()


@pytest.mark.parametrize("name", NAMES)
def test_slope(name, device):
    y = launch(slope_kernel, device)[1].numpy()[NAMES.index(name)]
    expected = reference.ACTIVATIONS[name].slope(points().astype(np.float64))
    assert (np.abs(y - expected) <= tolerance(expected)).all()


@pytest.mark.parametrize("text", ["z", "(z) + (z)", "wp::exp(z)", "(z + 1.0f) * 2.0f", "((z) - (z))", "(z)"])
def test_texts_are_one_operand(text):
    own = activations.Activation("own", text, text)
    assert own.value == own.derivative == (text if text in ("((z) - (z))", "(z)") else f"({text})")
    assert pickle.loads(pickle.dumps(own)) == own


@pytest.mark.parametrize("name", ["softplus", "squareplus"])
def test_tails_are_not_lost(name, device):
    """Small results keep their digits: 1 / z for squareplus, exp(z) for softplus."""
    values = np.array([-80.0, -20.0, -12.0, -7.0] if name == "softplus" else [-1e4, -3e3, -100.0, -5.0])
    z = wp.array(values, dtype=float, device=device)
    y, slopes = (wp.zeros((len(NAMES), len(z)), dtype=float, device=device) for _ in range(2))
    wp.launch(value_kernel, len(z), [z], [y], device=device)
    wp.launch(slope_kernel, len(z), [z], [slopes], device=device)
    f = (lambda z: np.log1p(np.exp(z))) if name == "softplus" else (lambda z: 2 / (np.sqrt(z * z + 4) - z))
    slope = (lambda z: 1 / (1 + np.exp(-z))) if name == "softplus" else (lambda z: f(z) / np.sqrt(z * z + 4))
    np.testing.assert_allclose(y.numpy()[NAMES.index(name)], f(values), rtol=1e-5)  # of the exponential of -80
    np.testing.assert_allclose(slopes.numpy()[NAMES.index(name)], slope(values), rtol=1e-5)


def test_adjoint(device):
    z, y, tape = launch(value_kernel, device)
    gradient = np.random.default_rng(0).normal(size=y.shape).astype(np.float32)
    y.grad.assign(gradient)
    tape.backward()
    slopes = launch(slope_kernel, device)[1].numpy()
    np.testing.assert_allclose(z.grad.numpy(), (slopes * gradient).sum(axis=0), rtol=1e-5, atol=1e-3)


def test_extremes_stay_finite(device):
    """Far out, activations are their asymptotes, and not infinity minus infinity."""
    z = wp.array([-1e4, 1e4], dtype=float, device=device)
    y = wp.zeros((len(NAMES), 2), dtype=float, device=device)
    wp.launch(value_kernel, 2, [z], [y], device=device)
    wp.launch(slope_kernel, 2, [z], [slopes := wp.zeros_like(y)], device=device)
    for name, far, slope in zip(NAMES, y.numpy(), slopes.numpy(), strict=True):
        if "exponential" not in name:
            assert np.isfinite([*far, *slope]).all(), name
    at = dict(zip(NAMES, y.numpy(), strict=True))
    assert at["sigmoid"].tolist() == [0, 1] and at["tanh"].tolist() == [-1, 1]
    for name in ("relu", "silu", "gelu", "softplus", "squareplus"):
        np.testing.assert_allclose(at[name], [0, 1e4], atol=1e-3)
