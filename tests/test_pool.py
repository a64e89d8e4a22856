"""Many networks in one kernel share one pool of shared memory, as do rows that are loaded beside them."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from networks import bound, error, expected, random_biases, samples

from warp_neural import MLP
from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.coopvec.network import make_network
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.spec import FLOAT16, NetworkSpec, Parameters

N_IN, N_OUT, WIDTH = 20, 5, 64
FAST = {"optimization_level": 1}  # a third of the time to compile; as much shared memory
KINDS = [
    {"precision": "float16"},
    {"precision": "float16", "accumulation": "float16"},
    {"precision": "float16", "output_activation": activations.sigmoid},
    {"precision": "bfloat16"},
    {"precision": "bfloat16", "output_activation": activations.sigmoid},
    {"precision": "int8"},
]


def make_six(activation: Activation, device) -> list[MLP]:
    return [random_biases(MLP(N_IN, N_OUT, WIDTH, 1, activation=activation, **kind, device=device)) for kind in KINDS]


@cache
def make_six_kernel(activation: Activation, **options) -> wp.Kernel:
    """For blocks of 256 threads, where the six would need 96 KB if each had memory of its own."""
    nets = make_six(activation, "cpu")
    a, b, c, d, e, f = [net.func for net in nets]
    P, Q, R, S, T, U = [net.Params for net in nets]
    vec_in, vec_out = nets[0].vec_in, nets[0].vec_out

    @wp.kernel(module="unique", module_options={"block_dim": 256, **options})
    def six_kernel(
        p: P,
        q: Q,
        r: R,
        s: S,
        t: T,
        u: U,
        x: wp.array[vec_in],
        y: wp.array2d[vec_out],
    ):
        i = wp.tid()
        v = x[i]
        y[0, i] = a(p, v)
        y[1, i] = b(q, v)
        y[2, i] = c(r, v)
        y[3, i] = d(s, v)
        y[4, i] = e(t, v)
        y[5, i] = f(u, v)

    return six_kernel


NO_CUDA = pytest.mark.skipif(not wp.is_cuda_available(), reason="takes long; one architecture is compiled anywhere")


@pytest.mark.parametrize("arch", [pytest.param(80, marks=NO_CUDA), 90, pytest.param(120, marks=NO_CUDA)])
def test_six_networks_with_gradients_compile(arch, tmp_path):
    (artifact,) = wp.compile_aot_module(
        make_six_kernel(activations.relu, **FAST).module, arch=arch, module_dir=tmp_path
    )
    assert artifact.stat().st_size > 0


def test_six_networks_agree_with_float64(device):
    """Values, gradients of all parameters, and of the input that they share."""
    n = 300
    nets = make_six(activations.silu, device)
    vec_in, vec_out = nets[0].vec_in, nets[0].vec_out
    x = wp.array(samples(n, N_IN), dtype=vec_in, device=device, requires_grad=True)
    y = wp.zeros((len(nets), n), dtype=vec_out, device=device, requires_grad=True)
    dy = np.stack([samples(n, N_OUT, seed) for seed in range(len(nets))])
    with wp.Tape() as tape:
        arguments = [*(net.params for net in nets), x, y]
        wp.launch(make_six_kernel(activations.silu), n, arguments, device=device, block_dim=256)
    tape.backward(grads={y: wp.array(dy, dtype=vec_out, device=device)})
    truth = [expected(net, x.numpy(), g) for net, g in zip(nets, dy, strict=True)]
    for net, value, result in zip(nets, y.numpy(), truth, strict=True):
        layers = zip(result.dw, result.db, strict=True)
        gradient = np.hstack([g.ravel() for layer in layers for g in layer])
        assert error(value, result.y) <= bound(net)
        assert error(net.gradient.numpy()[: len(gradient)], gradient) <= 2 * bound(net)
    assert error(x.grad.numpy(), sum(result.dx for result in truth)) <= 2 * max(map(bound, nets))


def test_rows_and_networks_of_blocks_of_1024_threads_compile(tmp_path):
    """Rows of several lengths and a network with gradients, in the 32 KB that such a block has."""
    spec = NetworkSpec((64, 64, 16), format=FLOAT16, dtype=wp.float16)
    network, store = make_network(spec), make_store(16, wp.float16)
    load, other = make_load(64, wp.float16), make_load(128, wp.float16)

    @wp.kernel(module="unique", launch_bounds=1024, module_options={"block_dim": 1024, **FAST})
    def kernel(params: Parameters, x: wp.array2d[wp.float16], z: wp.array2d[wp.float16], y: wp.array2d[wp.float16]):
        i = wp.tid()
        v = load(x, i)
        v[0] += other(z, i)[100]
        store(y, i, network(params, v))

    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0
