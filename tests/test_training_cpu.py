"""The fused step on the CPU: gradients against float64 NumPy and the taped step, samples, steps that go wrong."""

from functools import cache

import numpy as np
import pytest
import reference_networks as reference
import warp as wp
from networks import error, random_biases, samples

import warp_neural as wn
from warp_neural import activations, encodings
from warp_neural.train.cpu_steps import FusedCpu

A = activations


@wp.struct
class Pairs:
    x: wp.array2d[float]
    target: wp.array2d[float]


@cache
def make_sample(n_in: int, n_out: int, dtype: type):
    vec_in, vec_out = wp.types.vector(n_in, dtype), wp.types.vector(n_out, float)

    @wp.func
    def sample(index: int, random: wn.random.Stream, pairs: Pairs):
        x = vec_in()
        target = vec_out()
        for k in range(pairs.x.shape[1]):
            x[k] = dtype(pairs.x[index, k])
        for n in range(pairs.target.shape[1]):
            target[n] = pairs.target[index, n]
        return x, target

    return sample


@wp.func
def noise(index: int, random: wn.random.Stream):
    u = wn.random.uniform(random, 0)
    return wp.vec2(u[0], u[1]), wp.vec3(u[0], u[0] * u[1], u[2])


def make_net(n_in, n_out, width, depth, **options):
    return random_biases(wn.MLP(n_in, n_out, width, depth, seed=1, device="cpu", **options))


def trainer(net, n, **options):
    data, n_out = Pairs(), net.n_out
    x, target = samples(n, net.n_in), samples(n, n_out, 1)
    data.x, data.target = (wp.array(a, dtype=float, device="cpu") for a in (x, target))
    sample = make_sample(net.n_in, n_out, net.spec.dtype)
    return wn.Trainer(net, sample=sample, data=data, **{"batch": n} | options), x, target


def true_gradient(net, x, target):
    """Of the mean of squares, in the order of `net.master`."""
    functions = [reference.ACTIVATIONS[net.spec.activation_of(i).name] for i in range(len(net.spec.layers))]
    weights = [reference.rounded(w, net.precision) for w in net.weights]
    y = reference.mlp(weights, net.biases, functions, x)
    _, dw, db, _ = reference.mlp(weights, net.biases, functions, x, 2 * (y - target) / target.size)
    return np.concatenate([np.concatenate([w.ravel(), b]) for w, b in zip(dw, db, strict=True)])


# n_in, n_out, width, depth, hidden and output activation, precision: each activation once
CASES = [
    (2, 3, 16, 0, A.linear, A.squareplus, "float32"),
    (9, 3, 20, 2, A.elu, A.elu, "float16"),
    (7, 1, 16, 1, A.gelu, A.exponential, "float32"),
    (5, 16, 20, 2, A.leaky_relu, A.sigmoid, "float32"),
    (48, 3, 32, 5, A.relu, A.linear, "float32"),
    (3, 4, 64, 3, A.sine, A.tanh, "float32"),
    (17, 10, 128, 4, A.silu, A.shifted_exponential, "float32"),
    (3, 3, 36, 2, A.softplus, A.relu, "float16"),
]


@pytest.mark.parametrize("n", [1, 150])
@pytest.mark.parametrize("n_in, n_out, width, depth, hidden, output, precision", CASES)
def test_gradient(n_in, n_out, width, depth, hidden, output, precision, n):
    net = make_net(n_in, n_out, width, depth, activation=hidden, output_activation=output, precision=precision)
    run, x, target = trainer(net, n)
    assert isinstance(run.launches, FusedCpu)
    gradient = run.gradient()
    assert error(gradient, true_gradient(net, x, target)) < {"float32": 1e-5, "float16": 1e-2}[precision]
    assert np.array_equal(gradient, run.gradient())  # nothing is left over


@pytest.mark.parametrize(
    "precision, accumulation, dtype",
    [
        ("float16", "float16", float),
        ("e4m3", "float16", float),
        ("float16", "float32", wp.float16),
    ],
)
def test_rounding_is_that_of_the_network(precision, accumulation, dtype):
    """Only the rounding of results and of their gradients to the callers' float16 differs."""
    net = make_net(5, 3, 20, 2, precision=precision, accumulation=accumulation, dtype=dtype)
    mine, taped = (trainer(net, 100, fused=fused)[0].gradient() for fused in (None, False))
    assert error(mine, taped) < (1e-6 if dtype is float else 1e-3)


def test_encoding_with_parameters_learns():
    parts = (encodings.Frequency(3), encodings.LatentTexture(6, 6, 4))
    net = make_net(2, 3, 32, 1, encoding=encodings.Concatenate(parts), precision="float32")
    mine, taped = (trainer(net, 150, fused=fused)[0].gradient() for fused in (None, False))
    for part in (slice(0, net.spec.n_parameters), slice(net.encoding_start, None)):
        assert mine[part].any()
        assert error(mine[part], taped[part]) < 1e-5


def after(steps, path=None, **options):
    """Parameters and losses of a run on random samples, cut in two by a checkpoint at `path`."""
    net = make_net(2, 3, 16, 1, precision="float32")
    run = wn.Trainer(net, sample=noise, batch=[70, 200], batches=2, seed=3, average=0.9, **options)
    run.run(steps // 2, quiet=True)
    if path:
        run.save(path)
        net = make_net(2, 3, 16, 1, precision="float32")
        run = wn.Trainer(net, sample=noise, batch=[70, 200], batches=2, seed=3, average=0.9, **options)
        run.load(path)
    run.run(steps - steps // 2, quiet=True)
    return net.master.numpy().copy(), run.losses, run.averaged


def test_runs_are_equal_bit_for_bit_and_resume(tmp_path):
    whole, again, resumed = after(7), after(7), after(7, tmp_path / "run.safetensors")
    for a, b, c in zip(whole, again, resumed, strict=True):
        assert np.array_equal(a, b)
        assert np.array_equal(a, c)


def test_samples_are_those_of_the_taped_step():
    mine, taped = after(5), after(5, fused=False)
    np.testing.assert_allclose(mine[1], taped[1], rtol=1e-5)
    np.testing.assert_allclose(mine[0], taped[0], rtol=0, atol=1e-5)


def test_gradients_that_overflow_skip_the_step():
    net = make_net(2, 3, 16, 1, precision="float32")
    before = net.master.numpy().copy()
    run = wn.Trainer(net, sample=noise, batch=100, loss_scale=3e38)
    run.run(2, quiet=True)
    assert run.skipped == 2
    assert np.isfinite(run.losses).all()
    assert np.array_equal(net.master.numpy(), before)


def test_a_bad_target_skips_the_step_and_leaves_no_trace():
    net = make_net(2, 3, 16, 1, precision="float32")
    run, x, target = trainer(net, 100)
    bad = target.copy()
    bad[99] = np.inf
    run.launches.data.target.assign(bad)
    run.run(1, quiet=True)
    assert run.skipped == 1
    run.launches.data.target.assign(target)
    run.progress.batch.assign(np.array([90], np.int32))
    assert error(run.gradient() * 100 / 90, true_gradient(net, x[:90], target[:90])) < 1e-5


@pytest.mark.parametrize("options", [{"precision": "int8"}, {"implementation": "per_thread"}])
def test_other_networks_train_taped(options):
    net = make_net(2, 3, 16, 1, **options)
    assert not wn.Trainer(net, sample=noise, batch=10).fused
    with pytest.raises(wn.InputError, match="fused=True"):
        wn.Trainer(net, sample=noise, batch=10, fused=True)
