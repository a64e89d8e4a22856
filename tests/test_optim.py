"""Optimizers against float64 NumPy; schedules; parameters in one buffer; steps in a CUDA graph."""

import numpy as np
import pytest
import reference
import warp as wp

from warp_neural import InputError
from warp_neural.train.optim import SGD, Adam, Parameters, cosine, exponential, linear

STEPS = 25


def gradients(size, seed=0):
    """Of very different magnitudes, some zero."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-6, 2, size)
    scale[0] = 0
    return [(rng.normal(size=size) * scale).astype(np.float32) for _ in range(STEPS)]


@pytest.mark.parametrize(
    ("optimizer", "truth", "options"),
    [
        (Adam, reference.adam, {}),
        (Adam, reference.adam, {"beta1": 0.5, "beta2": 0.9, "eps": 1e-3, "weight_decay": 0.1}),
        (SGD, reference.sgd, {}),
        (SGD, reference.sgd, {"momentum": 0.9, "weight_decay": 0.1}),
    ],
)
@pytest.mark.parametrize("dtype", [wp.float32, wp.vec3, wp.mat22])
def test_steps_against_float64(device, optimizer, truth, options, dtype):
    start = np.random.default_rng(1).random((10, 4, *getattr(dtype, "_shape_", ()))).astype(np.float32)
    parameters = wp.array(start, dtype=dtype, requires_grad=True)
    rates = cosine(1e-2, 0.0, STEPS)
    stepper = optimizer(parameters, lr=rates, clear=True, **options)
    drawn = gradients(start.size)
    for gradient in drawn:
        parameters.grad.assign(wp.array(gradient.reshape(start.shape), dtype=dtype))
        stepper.step()
    expected = truth(start.ravel(), drawn, rates[:STEPS].astype(np.float64), **options)
    np.testing.assert_allclose(parameters.numpy().ravel(), expected, rtol=1e-5, atol=1e-5)
    assert (parameters.grad.numpy() == 0).all()
    assert stepper.steps.numpy()[0] == STEPS


def test_one_step_of_several_arrays(device):
    """Views keep dtype and shape, share the flat buffer, and an optimizer moves all of them."""
    arrays = {
        "albedo": wp.array(np.ones((2, 3, 3)), dtype=wp.vec3),
        "roughness": wp.array(np.full((2, 3), 2.0), dtype=float),
        "turn": wp.array(np.full((4, 2, 2), 3.0), dtype=wp.mat22),
    }
    parameters = Parameters(**arrays)
    assert parameters.flat.shape == (18 + 6 + 16,)
    for name, array in arrays.items():
        view = parameters[name]
        assert (view.dtype, view.shape, view.grad.dtype) == (array.dtype, array.shape, array.dtype)
        np.testing.assert_array_equal(view.numpy(), array.numpy())
        view.grad.fill_(1.0)
    SGD(parameters, lr=0.5).step()
    for name, value in parameters.numpy().items():
        np.testing.assert_array_equal(value, arrays[name].numpy() - 0.5)
    parameters["roughness"].fill_(7.0)
    np.testing.assert_array_equal(parameters.flat.numpy()[18:24], 7.0)


def test_rates_end_where_they_should():
    for schedule in (linear, cosine, exponential):
        rates = schedule(0.1, 0.001, 10)
        np.testing.assert_allclose(rates[[0, -1]], [0.1, 0.001], rtol=1e-6)
        assert len(rates) == 11 and (np.diff(rates) < 0).all()
    np.testing.assert_allclose(cosine(1.0, 0.0, 10)[5], 0.5)
    np.testing.assert_allclose(linear(1.0, 0.0, 10)[5], 0.5)
    np.testing.assert_allclose(exponential(1.0, 0.01, 10)[5], 0.1, rtol=1e-6)


def test_the_last_rate_stays(device):
    parameters = wp.zeros(1, dtype=float, requires_grad=True)
    parameters.grad.fill_(1.0)
    optimizer = SGD(parameters, lr=np.array([1.0, 0.5]))
    for _ in range(4):
        optimizer.step()
    assert parameters.numpy()[0] == -(1.0 + 3 * 0.5)


def test_wrong_parameters_are_refused(device):
    refused = [
        (lambda: Adam(wp.zeros(3, dtype=float)), "requires_grad"),
        (lambda: Adam(wp.zeros(3, dtype=wp.float16, requires_grad=True)), "float32"),
        (lambda: Adam(np.zeros(3)), "parameters='ndarray': expected a Warp array"),
        (lambda: Adam(lr=float("nan")), "lr=nan: expected a rate"),
        (lambda: Adam(lr="fast"), "lr='fast': expected a rate"),
        (lambda: Adam(beta2=1.0), r"Adam: beta2=1.0: expected a number in \[0, 1\)"),
        (lambda: Adam(eps=0.0), "Adam: eps=0.0: expected a positive number"),
        (lambda: SGD(weight_decay=-1), "SGD: weight_decay=-1: expected a finite number"),
        (lambda: Parameters(), "at least one, by name"),
        (lambda: Parameters(albedo=np.zeros(3)), "Parameters: albedo='ndarray': expected a Warp array"),
        (lambda: linear(1.0, 0.0, 0), "steps=0: expected a whole number"),
        (lambda: cosine(-1.0, 0.0, 5), "start=-1.0: expected a rate"),
        (lambda: exponential(1.0, 0.0, 5), "expected positive rates"),
    ]
    for make, message in refused:
        with pytest.raises(InputError, match=message) as error:
            make()
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", [1.0, -0.1, float("nan"), float("inf"), 1 - 1e-12, 1e300, 10**400, "0.9", None])
@pytest.mark.parametrize("name", ["beta1", "beta2", "momentum"])
def test_decays_are_those_of_float32(name, value):
    """1 - 1e-12 is 1 there, and 1 / (1 - 1) no correction."""
    with pytest.raises(InputError, match=f"{name}=.*: expected a number in") as error:
        (SGD if name == "momentum" else Adam)(**{name: value})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), 1e300, "0.1", None])
@pytest.mark.parametrize("name", ["eps", "weight_decay", "lr"])
def test_numbers_are_those_of_float32(name, value):
    with pytest.raises(InputError, match=f"{name}=.*: expected a"):
        Adam(**{name: value})
    with pytest.raises(InputError, match="eps=1e-300: expected a positive number of float32"):
        Adam(eps=1e-300)


def test_steps_are_not_recorded(device):
    """A step under a tape is no part of what is differentiated."""
    parameters = wp.zeros(3, dtype=float, device=device, requires_grad=True)
    optimizer = Adam(parameters)
    with wp.Tape() as tape:
        optimizer.step()
    assert not tape.launches


def test_what_they_are_in_one_line():
    assert str(Adam(lr=linear(0.1, 0.0, 4))).startswith(
        "Adam(lr=0.1 to 0 in 5 steps, beta1=0.9, beta2=0.999, eps=1e-08"
    )
    assert str(SGD(lr=0.5, momentum=0.9)) == "SGD(lr=0.5, momentum=0.9, weight_decay=0)"
    arrays = {"albedo": wp.zeros((2, 3), dtype=wp.vec3, device="cpu"), "bias": wp.zeros(1, dtype=float, device="cpu")}
    assert str(Parameters(**arrays)) == "Parameters(albedo=vec3f [2, 3], bias=float32 [1], cpu)"


@pytest.mark.cuda
@pytest.mark.skipif(not wp.is_cuda_available(), reason="CUDA graphs need a CUDA device")
def test_a_replayed_graph_advances():
    drawn = wp.array(gradients(100)[0], device="cuda:0")
    results = []
    for replay in (False, True):
        parameters = wp.zeros(100, dtype=float, device="cuda:0", requires_grad=True)
        wp.copy(parameters.grad, drawn)
        optimizer = Adam(parameters, lr=cosine(1e-2, 0.0, STEPS))
        if replay:
            wp.load_module("warp_neural.kernels.nn.optimizers", device="cuda:0")
            with wp.ScopedCapture(device="cuda:0") as capture:
                optimizer.step()
        for _ in range(STEPS):
            if replay:
                wp.capture_launch(capture.graph)
            else:
                optimizer.step()
        results.append(parameters.numpy())
    np.testing.assert_array_equal(*results)
