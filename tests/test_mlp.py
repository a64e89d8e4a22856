"""The host side of a network: its parameters, how they are set, packed, calibrated and moved; what is refused."""

import numpy as np
import pytest
import reference_networks as reference
import warp as wp
from networks import error, evaluate, expected, gradients, random_biases, samples

from warp_neural import MLP, InputError
from warp_neural.nn import initialization


def test_parameters_are_row_major(device):
    net = MLP(5, 3, 17, 2, count=2, device=device)
    assert [w.shape for w in net.weights] == [(2, 17, 5), (2, 17, 17), (2, 3, 17)]
    assert [b.shape for b in net.biases] == [(2, 17), (2, 17), (2, 3)]
    assert net.n_parameters == 17 * 5 + 17 + 17 * 17 + 17 + 3 * 17 + 3
    assert (net.n_in, net.width, net.depth, net.n_out, net.precision) == (5, 17, 2, 3, "float16")
    assert len(net.master) == len(net.gradient) == 2 * net.n_parameters
    single = MLP(5, 3, 17, 2, device=device)
    assert [w.shape for w in single.weights] == [(17, 5), (17, 17), (3, 17)]
    master = np.hstack([np.hstack([w.ravel(), b]) for w, b in zip(single.weights, single.biases, strict=True)])
    np.testing.assert_array_equal(single.master.numpy(), master)


def test_set_parameters(device):
    net = MLP(5, 3, 17, 1, device=device)
    weights, biases = [w + 1 for w in net.weights], [b - 1 for b in net.biases]
    net.weights, net.biases = weights, biases
    for a, b in zip(net.weights + net.biases, weights + biases, strict=True):
        np.testing.assert_array_equal(a, b)
    x = samples(32, 5)
    assert error(evaluate(net, x).y, expected(net, x, np.zeros((32, 3))).y) < 2e-3
    with pytest.raises(ValueError, match="read-only"):
        net.weights[0][:] = 0
    with pytest.raises(InputError, match="weights: a list of 1 arrays; give one for each of 2 layers"):
        net.weights = weights[:1]
    with pytest.raises(InputError, match=r"weights of layer 0: shape \(5, 17\); expected \(17, 5\)"):
        net.weights = [w.T for w in weights]
    with pytest.raises(InputError, match="biases of layer 1: str; expected numbers"):
        net.biases = [biases[0], "none"]
    for values in ([1.0, 2.0], [weights[0][:1], weights[1]], [weights[0][None], weights[1]]):
        with pytest.raises(InputError, match=r"weights of layer 0: shape .*; expected \(17, 5\)"):
            net.weights = values
    with pytest.raises(InputError, match=r"biases of layer 1: shape \(1,\); expected \(3,\)"):
        net.biases = [biases[0], [0.5]]
    with pytest.raises(InputError, match="weights: a list of float arrays; give one for each of 2 layers"):
        net.weights = 1.0
    np.testing.assert_array_equal(net.weights[0], weights[0])


def test_pack_follows_the_master(device):
    """What an optimizer does: change the float32 parameters in place, then pack."""
    net = MLP(5, 3, 17, 1, precision="float16", device=device)
    x = samples(32, 5)
    before = evaluate(net, x).y
    net.master.assign(2 * net.master.numpy())
    np.testing.assert_array_equal(evaluate(net, x).y, before)
    net.pack()
    np.testing.assert_allclose(evaluate(net, x).y, 4 * before, rtol=1e-6)


def test_seed(device):
    first, again, other = (MLP(5, 3, 17, 1, seed=seed, device=device) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.packed.numpy(), again.packed.numpy())
    assert not np.array_equal(first.packed.numpy(), other.packed.numpy())
    pair = MLP(5, 3, 17, 1, seed=1, count=2, device=device)
    np.testing.assert_array_equal(pair.weights[0][0], first.weights[0])
    assert not np.array_equal(pair.weights[0][0], pair.weights[0][1])


@pytest.mark.parametrize(
    ("function", "variance"),
    [
        (initialization.xavier_uniform, 2 / (100 + 400)),
        (initialization.xavier_normal, 2 / (100 + 400)),
        (initialization.he_uniform, 2 / 100),
        (initialization.he_normal, 2 / 100),
    ],
)
def test_initialization(function, variance):
    w = function(np.random.default_rng(0), 400, 100)
    assert w.shape == (400, 100)
    assert abs(w.mean()) < 0.02 * np.sqrt(variance)
    assert abs(w.var() / variance - 1) < 0.02


def test_int8_steps(device):
    """Steps cover the largest weight and the largest input that the float32 network meets."""
    net = random_biases(MLP(5, 3, 17, 1, precision="int8", count=2, device=device))
    x = 3 * samples(64, 5)
    net.calibrate(x)
    for i, steps in enumerate(net.steps.numpy()):
        weights, biases = [w[i] for w in net.weights], [b[i] for b in net.biases]
        h = reference.mlp(weights[:1], biases[:1], [reference.ACTIVATIONS["relu"]], x)
        largest = [[np.abs(x).max(), np.abs(weights[0]).max()], [np.abs(h).max(), np.abs(weights[1]).max()]]
        np.testing.assert_allclose(127 * steps, largest, rtol=1e-5)
    assert error(evaluate(net, x).y, reference.mlp([w[0] for w in net.weights], [b[0] for b in net.biases],
        [reference.ACTIVATIONS["relu"], reference.ACTIVATIONS["linear"]], x)) < 3e-2  # fmt: skip


def test_int8_of_zeros(device):
    net = MLP(5, 3, 17, 1, precision="int8", device=device)
    net.weights = [0 * w for w in net.weights]
    assert not evaluate(net, samples(32, 5)).y.any()


def test_gradients_add_up_and_zero(device):
    net = MLP(5, 3, 17, 1, precision="float32", device=device)
    vec_in, vec_out, func = net.vec_in, net.vec_out, net.func

    @wp.kernel(module="unique")
    def loss_kernel(params: net.Params, x: wp.array[vec_in], target: wp.array[vec_out], loss: wp.array[float]):
        i = wp.tid()
        difference = func(params, x[i]) - target[i]
        wp.atomic_add(loss, 0, wp.dot(difference, difference))

    x = wp.array(samples(64, 5), dtype=vec_in, device=device)
    target = wp.array(samples(64, 3, seed=1), dtype=vec_out, device=device)
    loss = wp.zeros(1, dtype=float, device=device, requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(loss_kernel, 64, [net.params, x, target, loss], device=device)
    tape.backward(loss)
    dy = 2 * (evaluate(net, x.numpy()).y - target.numpy())
    tape.zero()
    assert not net.gradient.numpy().any()
    tape.backward(loss)
    gradient = net.gradient.numpy().copy()
    truth = expected(net, x.numpy(), dy)
    for a, b in zip(gradients(net)[0], truth.dw, strict=True):
        assert error(a, b) < 1e-5
    tape.backward(loss)
    np.testing.assert_allclose(net.gradient.numpy(), 2 * gradient, rtol=1e-4, atol=1e-5)


def test_constant_parameters_take_no_gradient(device):
    """A network whose parameters need no gradient still has one to its inputs."""
    for implementation in ("cooperative", "per_thread"):
        net = MLP(5, 3, 17, 1, precision="float32", implementation=implementation, device=device)
        x, dy = samples(32, 5), samples(32, 3, seed=1)
        kernel_inputs = wp.array(x, dtype=net.vec_in, device=device, requires_grad=True)
        fixed = net.Params()
        fixed.assign(net.params)
        fixed.master = wp.array(net.master.numpy(), dtype=float, device=device)
        func, vec_in, vec_out = net.func, net.vec_in, net.vec_out

        @wp.kernel(module="unique")
        def fixed_kernel(params: net.Params, x: wp.array[vec_in], y: wp.array[vec_out]):
            i = wp.tid()
            y[i] = func(params, x[i])  # noqa: B023

        y = wp.zeros(32, dtype=vec_out, device=device, requires_grad=True)
        with wp.Tape() as tape:
            wp.launch(fixed_kernel, 32, [fixed, kernel_inputs, y], device=device)
        y.grad.assign(dy)
        tape.backward()
        assert error(kernel_inputs.grad.numpy(), expected(net, x, dy).dx) < 1e-5


def test_moves_between_devices(device):
    net = random_biases(MLP(5, 3, 17, 1, precision="float32", device="cpu"))
    x = samples(32, 5)
    before, weights = evaluate(net, x).y, net.weights
    assert net.to(device) is net and net.device == device
    np.testing.assert_array_equal(net.weights[0], weights[0])
    np.testing.assert_allclose(evaluate(net, x).y, before, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_in": 0}, "n_in=0: expected a whole number of 1 to 256"),
        ({"width": 257}, "width=257: expected"),
        ({"n_out": 300}, "n_out=300: expected"),
        ({"depth": 9}, "depth=9: expected a whole number of 0 to 8"),
        ({"depth": -1}, "depth=-1: expected"),
        ({"count": 0}, "count=0: expected a whole number of 1 to"),
        ({"width": 0}, "width=0: expected"),
        ({"n_in": 2.5}, "n_in=2.5: expected a whole number"),
        ({"activation": "relu"}, "activation='relu': expected one of wn.activations"),
        ({"encoding": "hash"}, "encoding='hash': expected one of wn.encodings"),
        ({"initialization": lambda rng, n_out, n_in: np.zeros((n_in, n_out))}, "initialization: gave shape"),
        ({"seed": "one"}, "seed='one': expected a whole number"),
        ({"device": "cuda:99"}, "device='cuda:99': not on this machine, which has cpu"),
        ({"precision": "fp12"}, "expected one of float32, tf32, float16, bfloat16, e4m3, e5m2, int8"),
        ({"implementation": "magic"}, "expected one of cooperative, per_thread, tiled"),
        ({"accumulation": "int32"}, "expected one of float32, float16"),
        ({"precision": "int8", "accumulation": "float16"}, "int8 accumulates in float32 only"),
        ({"precision": "bfloat16", "accumulation": "float16"}, "bfloat16 accumulates in float32 only"),
        ({"dtype": wp.float64}, "expected wp.float32 or wp.float16"),
    ],
)
def test_refuses(options, message):
    with pytest.raises(InputError, match=message) as error:
        MLP(**{"n_in": 5, "n_out": 3, "device": "cpu", **options})
    assert "\n" not in str(error.value)


def test_refuses_calibration_of_another_size():
    net = MLP(5, 3, 17, 1, precision="int8", device="cpu")
    for inputs in (np.zeros((10, 4)), np.zeros((0, 5)), np.full((10, 5), np.nan)):
        with pytest.raises(InputError, match=r"expected \[n, 5\], finite"):
            net.calibrate(inputs)
    with pytest.raises(InputError, match="float16 needs no steps"):
        MLP(5, 3, device="cpu").calibrate(np.zeros((10, 5)))


@pytest.mark.cuda
def test_pack_in_a_graph():
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device on this machine")
    net = MLP(5, 3, 17, 1, device="cuda:0")
    with wp.ScopedCapture("cuda:0") as capture:
        net.pack()
    packed = net.packed.numpy()
    net.master.assign(2 * net.master.numpy())
    wp.capture_launch(capture.graph)
    assert not np.array_equal(net.packed.numpy(), packed)
