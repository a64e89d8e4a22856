"""Every implementation and precision of a network against float64 NumPy, forward and back."""

import os

import numpy as np
import pytest
import reference_networks as reference
import warp as wp
import warp.autograd
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from networks import BLOCK, ROUNDING, bound, error, evaluate, expected, flat, make_kernel, random_biases, samples

from warp_neural import MLP
from warp_neural.kernels.nn import activations

PRECISIONS = [
    ("float32", "float32"),
    ("tf32", "float32"),
    ("float16", "float32"),
    ("float16", "float16"),
    ("bfloat16", "float32"),
    ("e4m3", "float32"),
    ("e4m3", "float16"),
    ("e5m2", "float32"),
    ("e5m2", "float16"),
    ("int8", "float32"),
]
all_precisions = pytest.mark.parametrize(("precision", "accumulation"), PRECISIONS)
all_implementations = pytest.mark.parametrize("implementation", ["cooperative", "per_thread", "tiled"])
N = 4 * BLOCK


@all_precisions
def test_small_integers_are_exact(precision, accumulation, device):
    """No value here exceeds 8, the last whole number before e5m2 leaves one out."""
    rng = np.random.default_rng(0)
    net = MLP(20, 5, 33, 2, precision=precision, accumulation=accumulation, device=device)
    weights = [np.zeros_like(w) for w in net.weights]
    for w in weights:
        for row in w:
            row[rng.choice(len(row), 2, replace=False)] = rng.choice([-1, 1], 2)
    for w in weights:  # int8's step of 1; what it multiplies is 0
        w[:, 0] = 0
        w[-1, 0] = 127
    for w in weights[:-1]:
        w[0] = 0
    net.weights = weights
    net.biases = [np.zeros(33), np.zeros(33), rng.integers(-2, 3, 5)]
    net.steps.fill_(1)
    net.pack()
    x = rng.integers(-2, 3, (N, 20)).astype(np.float32)
    x[:, 0] = 0
    result = evaluate(net, x, np.zeros((N, 5)))
    np.testing.assert_array_equal(result.y, expected(net, x, np.zeros((N, 5))).y)


@all_implementations
def test_integer_gradients_are_exact(implementation, device):
    rng = np.random.default_rng(0)
    shape = {"activation": activations.linear, "precision": "float32", "implementation": implementation}
    net = MLP(17, 5, 33, 1, **shape, device=device)
    net.weights = [rng.integers(-3, 4, w.shape) for w in net.weights]
    net.biases = [rng.integers(-3, 4, b.shape) for b in net.biases]
    x, dy = rng.integers(-2, 3, (N, 17)).astype(np.float32), rng.integers(-2, 3, (N, 5)).astype(np.float32)
    for a, b in zip(flat(evaluate(net, x, dy)), flat(expected(net, x, dy)), strict=True):
        np.testing.assert_array_equal(a, np.rint(b))


@all_precisions
def test_rounds_where_tensor_cores_do(precision, accumulation, device):
    """Equal to NumPy, rounding at the same places. On CUDA sums come in another order, which may turn a rounding."""
    net = random_biases(MLP(20, 5, 33, 2, precision=precision, accumulation=accumulation, device=device))
    x = samples(N, 20)
    f = [reference.ACTIVATIONS["relu"]] * 2 + [reference.ACTIVATIONS["linear"]]
    steps = net.steps.numpy()[0]
    rounded = reference.mlp_rounded(net.weights, net.biases, f, x, precision, accumulation, steps)
    y = evaluate(net, x).y
    if device.is_cpu:
        np.testing.assert_array_equal(y, rounded)
    else:
        assert error(y, rounded) <= bound(net) / 4


@pytest.mark.cuda
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")
@pytest.mark.parametrize("sizes", [(20, 5, 33, 2), (64, 16, 64, 3), (5, 40, 7, 0)])
@pytest.mark.parametrize("precision", [p for p, accumulation in PRECISIONS if accumulation == "float32"])
def test_cuda_gives_what_the_cpu_gives(precision, sizes):
    """Float32 accumulation: within two units in the last place of the precision, at each vector's largest element."""
    n_in, n_out, width, depth = sizes
    nets = [random_biases(MLP(n_in, n_out, width, depth, precision=precision, device=d)) for d in ("cpu", "cuda:0")]
    cpu, cuda = [evaluate(net, samples(N + 7, n_in)).y for net in nets]
    largest = np.abs(cpu).max(axis=1, keepdims=True)
    if precision == "int8":
        unit = largest / 127
    else:
        unit = 2.0 ** np.floor(np.log2(largest)) * 2 * ROUNDING.get(precision, 2**-24)
    assert np.all(np.abs(cuda - cpu) <= 2 * unit)


@all_precisions
def test_near_float64(precision, accumulation, device):
    net = random_biases(MLP(20, 5, 33, 2, precision=precision, accumulation=accumulation, device=device))
    x = samples(N, 20)
    assert error(evaluate(net, x).y, expected(net, x, np.zeros((N, 5))).y) <= bound(net)


SIZES = [(3, 33, 2, 5), (1, 3, 3, 1), (100, 17, 1, 1), (33, 100, 1, 17), (5, 1, 2, 33), (1, 1, 8, 1)]
SHAPES = [("cooperative", s) for s in SIZES] + [("per_thread", s) for s in SIZES[:2]] + [("tiled", SIZES[0])]


@pytest.mark.parametrize(("implementation", "sizes"), SHAPES)
def test_gradients(implementation, sizes, device):
    """Float32 keeps to 1e-5, which is what sums over the samples lose."""
    n_in, width, depth, n_out = sizes
    shape = {"activation": activations.tanh, "output_activation": activations.silu, "precision": "float32"}
    net = random_biases(MLP(n_in, n_out, width, depth, **shape, implementation=implementation, device=device))
    x, dy = samples(N, n_in), samples(N, n_out, seed=1)
    for a, b in zip(flat(evaluate(net, x, dy)), flat(expected(net, x, dy)), strict=True):
        assert error(a, b) <= 1e-5


@all_precisions
def test_gradients_of_rounded_networks(precision, accumulation, device):
    """Within the roundings of forward and back; the derivative of ReLU turns where a rounding turns the sign."""
    kind = {"precision": precision, "accumulation": accumulation, "activation": activations.silu}
    net = random_biases(MLP(17, 5, 33, 2, **kind, device=device))
    x, dy = samples(N, 17), samples(N, 5, seed=1)
    limit = max(2 * bound(net), 1e-5)
    for a, b in zip(flat(evaluate(net, x, dy)), flat(expected(net, x, dy)), strict=True):
        assert error(a, b) <= limit


@pytest.mark.parametrize("first", range(0, len(activations.ALL), 2))
def test_activations_inside(first, device):
    hidden, output = (activations.ALL * 2)[first : first + 2]
    net = MLP(5, 19, 17, 1, activation=hidden, output_activation=output, precision="float32", device=device)
    x, dy = samples(N, 5), samples(N, 19, seed=1)
    for a, b in zip(flat(evaluate(net, x, dy)), flat(expected(net, x, dy)), strict=True):
        assert error(a, b) <= 1e-5


@all_implementations
def test_many_networks(implementation, device):
    """Each sample has its own network; in whole blocks, which the tiled version needs."""
    shape = {"precision": "float32", "implementation": implementation, "activation": activations.tanh}
    net = random_biases(MLP(17, 5, 33, 1, **shape, count=3, device=device))
    x, dy = samples(N, 17), samples(N, 5, seed=1)
    index = np.random.default_rng(0).integers(0, 3, N)
    if implementation == "tiled":
        index = np.arange(N) // BLOCK % 3
    result = evaluate(net, x, dy, index)
    weights, biases = net.weights, net.biases
    for i in range(3):
        mine = index == i
        f = [reference.ACTIVATIONS["tanh"], reference.ACTIVATIONS["linear"]]
        y, dw, db, dx = reference.mlp([w[i] for w in weights], [b[i] for b in biases], f, x[mine], dy[mine])
        assert error(result.y[mine], y) <= 1e-6
        assert error(result.dx[mine], dx) <= 1e-5
        for a, b in zip([*result.dw, *result.db], [*dw, *db], strict=True):
            assert error(a[i], b) <= 1e-5


@pytest.mark.parametrize("precision", ["float32", "float16"])
def test_any_control_flow(precision, device):
    """Early return, nested branches, loops of different length: every call sees its own thread's vector and network."""
    net = random_biases(MLP(20, 5, 33, 2, precision=precision, count=4, device=device))
    plain = make_kernel(net.spec, "cooperative")
    func, vec_in, vec_out = net.func, net.vec_in, net.vec_out

    @wp.kernel(module="unique", enable_backward=False)
    def flow_kernel(params: net.Params, kind: wp.array[int], x: wp.array[vec_in], y: wp.array[vec_out]):
        i = wp.tid()
        if kind[i] == 0:
            return
        own = net.select(params, i % 4)
        if kind[i] < 3:
            if kind[i] == 1:
                y[i] = func(own, x[i])
            else:
                y[i] = 2.0 * func(own, x[i])
        else:
            for _ in range(kind[i]):
                y[i] = y[i] + func(own, x[i])

    n = 3 * BLOCK + 7
    kind = np.random.default_rng(0).integers(0, 6, n)
    x = wp.array(samples(n, 20), dtype=vec_in, device=device)
    index = wp.array(np.arange(n) % 4, dtype=int, device=device)
    y, once = [wp.zeros(n, dtype=vec_out, device=device) for _ in range(2)]
    wp.launch(flow_kernel, n, [net.params, wp.array(kind, dtype=int, device=device), x, y], device=device)
    wp.launch(plain, n, [net.plain, index, x, once], device=device)
    # on CUDA, threads that call alone may add in another order, which may turn a rounding
    limit = 1e-6 if device.is_cpu or precision == "float32" else bound(net)
    assert error(y.numpy(), kind[:, None] * once.numpy()) <= limit


@all_implementations
def test_gradcheck(implementation, device):
    """Warp's own finite differences, at a width past the 16 trips up to which it unrolls loops."""
    shape = {"activation": activations.tanh, "precision": "float32", "implementation": implementation}
    net = random_biases(MLP(4, 3, 33, 1, **shape, device=device))
    func, vec_in = net.func, net.vec_in

    @wp.kernel(module="unique", module_options={"enable_mathdx_gemm": False})
    def check_kernel(x: wp.array[wp.vec4], params: net.Params, y: wp.array[wp.vec3]):
        i = wp.tid()
        y[i] = wp.vec3(func(params, vec_in(x[i])))

    x = wp.array(samples(BLOCK, 4), dtype=wp.vec4, device=device, requires_grad=True)
    y = wp.zeros(BLOCK, dtype=wp.vec3, device=device, requires_grad=True)
    options = {"eps": 1e-2, "block_dim": BLOCK, "device": device, "show_summary": False}
    assert wp.autograd.gradcheck(check_kernel, BLOCK, [x, net.params], [y], **options)


def test_float16_vectors(device):
    """Vectors of float16 in and out; the results are rounded to float16."""
    kind = {"precision": "float16", "dtype": wp.float16, "activation": activations.tanh}
    x, dy = samples(N, 17).astype(np.float16), samples(N, 5, seed=1).astype(np.float16)
    for implementation in ("cooperative", "per_thread"):
        net = random_biases(MLP(17, 5, 33, 1, **kind, implementation=implementation, device=device))
        result = evaluate(net, x, dy)
        assert result.y.dtype == np.float16
        for a, b in zip(flat(result), flat(expected(net, x, dy)), strict=True):
            assert error(a.astype(np.float64), b) <= 2e-3


@settings(
    max_examples=int(os.environ.get("WARP_NEURAL_EXAMPLES", "5")),
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    sizes=st.tuples(st.integers(1, 256), st.integers(1, 256), st.integers(1, 256)),
    depth=st.integers(0, 7),
    kind=st.sampled_from(PRECISIONS),
    n=st.integers(1, 4 * BLOCK),
    seed=st.integers(0, 1000),
)
def test_any_shape(device, sizes, depth, kind, n, seed):
    """Sizes 1 to 256, 1 to 8 layers, launches of any length. More with WARP_NEURAL_EXAMPLES: each compiles a module."""
    n_in, width, n_out = sizes
    shape = {"precision": kind[0], "accumulation": kind[1], "activation": activations.tanh, "seed": seed}
    net = random_biases(MLP(n_in, n_out, width, depth, **shape, device=device), seed)
    x, dy = samples(n, n_in, seed), samples(n, n_out, seed + 1)
    limit = max(2 * bound(net), 1e-5)
    for a, b in zip(flat(evaluate(net, x, dy)), flat(expected(net, x, dy)), strict=True):
        assert error(a, b) <= limit
