"""Parameters of another network, or of one that is not there: refused by Warp, or NaN, and nothing is read."""

import numpy as np
import pytest
import warp as wp
from networks import evaluate, expected, random_biases, samples
from test_trainer import line

import warp_neural as wn
from warp_neural.kernels.nn.activations import sine

SHAPES = [
    {"width": 32}, {"depth": 2}, {"precision": "bfloat16"}, {"precision": "int8"}, {"activation": sine},
    {"encoding": wn.encodings.LatentTexture(4, 4, 2)}, {"encoding": wn.encodings.LatentTexture(8, 4, 2)},
]  # fmt: skip


def make(device="cpu", **options):
    return wn.MLP(2, 3, **{"width": 16, "depth": 1, "device": device} | options)


def make_kernel(net, params_type):
    func, select, vec_in, vec_out = net.func, net.select, net.vec_in, net.vec_out

    @wp.kernel(module="unique")
    def kernel(params: params_type, network: wp.array[int], x: wp.array[vec_in], y: wp.array[vec_out]):
        i = wp.tid()
        y[i] = func(select(params, network[i]), x[i])

    return kernel


def launch(net, params, network, params_type=None, block_dim=256):
    x, y = (
        wp.zeros(len(network), dtype=dtype, device=net.device, requires_grad=True)
        for dtype in (net.vec_in, net.vec_out)
    )
    x.fill_(net.vec_in(0.25))
    network = wp.array(network, dtype=int, device=net.device)
    with wp.Tape() as tape:
        kernel = make_kernel(net, params_type or net.Params)
        wp.launch(kernel, len(network), [params, network, x], [y], device=net.device, block_dim=block_dim)
    net.gradient.zero_()
    y.grad.fill_(net.vec_out(1.0))
    tape.backward()
    return y.numpy(), x.grad.numpy()


def disguised(params, net):
    """Parameters of another network as a launch of `net` takes them."""
    result = net.Params()
    for member in net.Params.vars:
        setattr(result, member, getattr(params, member))
    return result


@pytest.mark.parametrize("options", SHAPES, ids=str)
def test_each_shape_has_a_type(options):
    first, again, other = make(), make(seed=1), make(**options)
    assert first.Params is again.Params is wn.MLP.from_state(first.state).Params and first.func is again.func
    assert first.Params is not other.Params and first.params.kind != other.params.kind
    with pytest.raises(Exception, match=r"Couldn't find function overload for .* types: .*Params_2_16_3_float16_"):
        launch(other, first.params, [0], first.Params)


@pytest.mark.parametrize("options", SHAPES[:3], ids=str)
def test_another_shape_gives_nan_and_reads_nothing(options, device):
    """Where a launch cannot see it."""
    net, other = make(device), make(device, **options)
    y, dx = launch(net, disguised(other.params, net), [0] * 70)
    assert np.isnan(y).all() and not dx.any() and not net.gradient.numpy().any() and not other.gradient.numpy().any()
    mixed = net.Params()  # nobody's, with arrays that a tape takes
    mixed.packed, mixed.master = net.packed, net.master
    y, dx = launch(net, mixed, [0] * 70)
    assert np.isnan(y).all() and not dx.any()


def test_a_network_that_is_not_there(device):
    net = random_biases(make(device, count=3))
    network = np.array([0, 1, 2, 3, -1, 1000000, -(2**31), 2**31 - 1] * 9)
    there = (network >= 0) & (network < 3)
    y, dx = launch(net, net.params, network)
    x = np.full((len(network), 2), 0.25, np.float32)
    right = evaluate(net, x, np.ones((len(network), 3), np.float32), np.where(there, network, 0))
    # on CUDA warps with lanes missing sum in another order, and whole warps round gradients to 16 bits
    np.testing.assert_allclose(y[there], right.y[there], rtol=0, atol=0 if device.is_cpu else 1e-6)
    np.testing.assert_allclose(dx[there], right.dx[there], rtol=0, atol=0 if device.is_cpu else 2e-3)
    assert np.isnan(y[~there]).all() and not dx[~there].any()


def test_functions_of_rows_and_of_encodings(device):
    net = make(device, encoding=wn.encodings.LatentTexture(4, 4, 2))
    of_row, encode = net.of_row, net.encode

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(params: net.Params, x: wp.array2d[float], y: wp.array2d[float]):
        i = wp.tid()
        y[i, 0] = of_row(params, x, i)[0]
        y[i, 1] = encode(params, wp.vec2(x[i, 0], x[i, 1]))[0]

    x, y = wp.array(samples(70, 2), dtype=float, device=device), wp.zeros((70, 2), dtype=float, device=device)
    wp.launch(kernel, 70, [net.params, x], [y], device=device)
    bound = 0 if device.is_cpu else 1e-6  # on CUDA the last warp, with lanes missing, sums in another order
    np.testing.assert_allclose(y.numpy()[:, 0], net.evaluate(x).numpy()[:, 0], rtol=0, atol=bound)
    assert np.isfinite(y.numpy()).all()
    wp.launch(kernel, 70, [disguised(make(device).params, net), x], [y], device=device)
    assert np.isnan(y.numpy()).all()


def test_parameters_of_ones_own(device):
    """Another buffer for the same shape: a copy of `net.params` with other arrays."""
    net, other = (
        random_biases(make(device, precision="float32")),
        random_biases(make(device, seed=1, precision="float32"), 1),
    )
    mixed = net.Params()
    mixed.assign(net.params)
    mixed.packed, mixed.master = other.packed, other.master
    y, _ = launch(net, mixed, [0] * 32)
    x = np.full((32, 2), 0.25, np.float32)
    np.testing.assert_allclose(y, expected(other, x, np.zeros((32, 3))).y, rtol=1e-5, atol=1e-6)


def test_launches_look_at_parameters(device):
    net, other = make(device), make(device, width=32)
    kernel = make_kernel(net, net.Params)
    network = wp.zeros(32, dtype=int, device=device)
    x, y = (wp.zeros(32, dtype=dtype, device=device) for dtype in (net.vec_in, net.vec_out))
    for wrong, name in ((other.params, "Params_2_32_3"), (net.plain, ".*Parameters"), (net.master, "array")):
        with pytest.raises(wn.InputError, match=f"kernel: params is a {name}.*, and the kernel takes a"):
            wp.launch(kernel, 32, [wrong, network, x, y], device=device)
    wp.launch(kernel, 32, [net.params, network, x, y], device=device)
    assert np.isfinite(y.numpy()).all()


@wp.struct
class Pair:
    a: float
    b: wp.array[float]


@wp.struct
class Single:
    a: wp.array[float]


@wp.kernel
def read_pair(pair: Pair, y: wp.array[float]):
    y[wp.tid()] = pair.a


def test_verified_launches(device):
    """Under `wn.config.verify` a launch looks at all its structs; those of the library pass."""
    net, y = make(device), wp.zeros(4, dtype=float, device=device)
    assert not wn.config.verify
    wn.config.verify = True
    try:
        with pytest.raises(wn.InputError, match=r"read_pair: pair is a .*Single, and the kernel takes a .*Pair"):
            wp.launch(read_pair, 4, [Single(), y], device=device)
        wp.launch(read_pair, 4, [Pair(), y], device=device)
        for fused in (None, False):
            wn.Trainer(net, sample=line, batch=64, fused=fused).run(2, quiet=True)
        net.evaluate(samples(5, 2))
    finally:
        wn.config.verify = False


@pytest.mark.parametrize("implementation", ["per_thread", "tiled"])
def test_other_implementations(implementation, device):
    net, other = (random_biases(make(device, width=width, implementation=implementation)) for width in (16, 32))
    x = np.full((64, 2), 0.25, np.float32)
    y, dx = launch(net, net.params, [0] * 64, block_dim=64)  # tiles take whole blocks
    right = evaluate(net, x, np.ones((64, 3), np.float32))
    np.testing.assert_allclose(y, right.y, rtol=1e-5)
    np.testing.assert_allclose(dx, right.dx, rtol=1e-5)
    y, dx = launch(net, disguised(other.params, net), [0] * 64, block_dim=64)
    assert np.isnan(y).all() and not dx.any()
