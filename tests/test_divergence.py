"""Networks that differ between the threads of a warp, at every block size; on the CPU the same answers."""

import numpy as np
import pytest
import reference_networks as reference
import warp as wp
from networks import bound, error, evaluate, expected, flat, gradients, random_biases, samples

from warp_neural import MLP
from warp_neural.kernels.nn import activations

INTERLEAVED = [1, 2, 5, 32]  # networks, dealt to consecutive threads in turn


def make_flow_kernel(net, block):
    """A thread in eleven returns at once; more than 256 threads a block need a bound on registers."""
    func, select, vec_in, vec_out = net.func, net.select, net.vec_in, net.vec_out

    @wp.kernel(module="unique", launch_bounds=block)
    def kernel(params: net.Params, count: int, x: wp.array[vec_in], y: wp.array[vec_out]):
        i = wp.tid()
        if i % 11 == 10:
            return
        y[i] = func(select(params, i * 7 % count), x[i])

    return kernel


@pytest.mark.parametrize(
    "precision, accumulation", [("float16", "float16"), ("bfloat16", "float32"), ("tf32", "float32")]
)
@pytest.mark.parametrize("block", [32, 96, 256, 544, 1024])
def test_interleaved_networks(precision, accumulation, block, device):
    if device.is_cpu and block != 256:
        pytest.skip("blocks are CUDA's")
    kind = {"precision": precision, "accumulation": accumulation, "activation": activations.silu}
    net = random_biases(MLP(20, 5, 33, 2, **kind, count=32, device=device))
    kernel, n = make_flow_kernel(net, block), 2 * block + 77
    x_values, dy = samples(n, 20), samples(n, 5, seed=1)
    x = wp.array(x_values, dtype=net.vec_in, device=device, requires_grad=True)
    silu, linear = reference.ACTIVATIONS["silu"], reference.ACTIVATIONS["linear"]
    for count in INTERLEAVED:
        y = wp.zeros(n, dtype=net.vec_out, device=device, requires_grad=True)
        net.gradient.zero_()
        x.grad.zero_()
        with wp.Tape() as tape:
            wp.launch(kernel, n, inputs=[net.params, count, x], outputs=[y], device=device, block_dim=block)
        tape.backward(grads={y: wp.array(dy, dtype=net.vec_out, device=device)})
        threads = np.arange(n)
        active, which = threads % 11 != 10, threads * 7 % count
        assert not y.numpy()[~active].any() and not x.grad.numpy()[~active].any()
        dw = gradients(net)[0]
        for i in range(count):
            mine = active & (which == i)
            weights, biases = [w[i] for w in net.weights], [b[i] for b in net.biases]
            truth = reference.mlp(weights, biases, [silu, silu, linear], x_values[mine], dy[mine])
            assert error(y.numpy()[mine], truth[0]) <= 2 * bound(net)
            assert error(x.grad.numpy()[mine], truth[3]) <= 3 * bound(net)
            for a, b in zip(dw, truth[1], strict=True):
                assert error(a[i], b) <= 3 * bound(net)


def test_gradients_reach_far_below_float16(device):
    """Gradients are scaled by a power of two for each warp: a loss's 1e-9 does not vanish in float16."""
    net = random_biases(MLP(17, 5, 33, 2, activation=activations.silu, device=device))
    x, dy = samples(96, 17), 1e-9 * samples(96, 5, seed=1)
    for a, b in zip(flat(evaluate(net, x, dy))[1:], flat(expected(net, x, dy))[1:], strict=True):
        assert error(a, b) <= 2 * bound(net)


def test_int8_is_the_same_in_any_company(device):
    """Sums are whole numbers: alone, in a whole warp, among other networks, each sample has the same result."""
    net = random_biases(MLP(20, 5, 33, 2, precision="int8", count=3, device=device))
    x, n = samples(77, 20), np.arange(77)
    each = [evaluate(net, x, index=0 * n + i).y for i in range(3)]
    np.testing.assert_array_equal(evaluate(net, x, index=n % 3).y, np.choose(n[:, None] % 3, each))
    np.testing.assert_array_equal(evaluate(net, x[:31]).y, each[0][:31])


def test_int8_relu_gradients(device):
    """Straight through the quantization; where that turns a ReLU's sign, gradients differ: a few in a hundred."""
    net = random_biases(MLP(17, 5, 33, 2, precision="int8", activation=activations.relu, device=device))
    x, dy = samples(512, 17), samples(512, 5, seed=1)
    for a, b in zip(flat(evaluate(net, x, dy)), flat(expected(net, x, dy)), strict=True):
        assert error(a, b) <= 0.25
