"""Loops that carry a state, and `check`, which finds the wrong gradients that Warp's own loops have."""

import numpy as np
import pytest
import warp as wp

import warp_neural as wn
from warp_neural.autodiff import check, loop

pytestmark = pytest.mark.usefixtures("device")
wp.set_module_options({"optimization_level": 1})  # run once: what counts is the time to compile
Double = wp.float64


def make_net(device=None):
    smooth = wn.activations.tanh
    return wn.MLP(4, 3, width=24, depth=1, precision="float32", activation=smooth, seed=1, device=device)


net = make_net("cpu")


@wp.func
def body(state: Double, rate: Double, gains: wp.array[Double], i: int) -> Double:
    return wp.sin(state * rate) + state * gains[i]


@wp.struct
class Ray:
    position: wp.vec3d
    distance: Double
    trips: int


@wp.struct
class Sphere:
    center: wp.vec3d
    radius: Double


@wp.func
def march(ray: Ray, direction: wp.vec3d, spheres: wp.array[Double], sphere: Sphere, i: int):
    """Half a step towards the sphere, of a radius of its own for each trip."""
    moved = ray
    moved.position = ray.position + direction * ray.distance * Double(0.5)
    moved.distance = wp.length(moved.position - sphere.center) - sphere.radius * spheres[i]
    moved.trips += 1
    return moved


@wp.func
def outside(ray: Ray, direction: wp.vec3d, spheres: wp.array[Double], sphere: Sphere, i: int):
    return ray.distance > Double(1.0e-4)


@wp.func
def recur(h: wp.vec3, params: net.Params, x: wp.array[float], i: int):
    return h + 0.3 * net.func(params, wp.vec4(h[0], h[1], h[2], x[i]))


@wp.func
def power(matrix: wp.mat22d, factor: wp.mat22d, i: int):
    return factor * matrix


few_loop = loop(body, checkpoints=2)
body_loop = loop(body)
march_loop = loop(march, outside, checkpoints=4)
net_loop = loop(recur)
power_loop = loop(power)


@wp.func
def nested(matrix: wp.mat22d, factor: wp.mat22d, i: int):
    return power_loop(matrix, factor, i) * Double(0.5)


nested_loop = loop(nested)


@wp.kernel
def plain_kernel(x: wp.array[Double], rate: wp.array[Double], gains: wp.array[Double], n: int, y: wp.array[Double]):
    state = x[0]
    for i in range(n):
        state = body(state, rate[0], gains, i)
    y[0] = wp.exp(Double(0.1) * state)


@wp.kernel
def body_kernel(
    x: wp.array[Double], rate: wp.array[Double], gains: wp.array[Double], trips: wp.array[int], y: wp.array2d[Double]
):
    i = wp.tid()
    y[0, i] = wp.exp(Double(0.1) * body_loop(x[i], rate[i], gains, trips[i]))
    y[1, i] = few_loop(x[i], rate[i], gains, trips[i])


@wp.kernel
def march_kernel(
    origins: wp.array[wp.vec3d],
    directions: wp.array[wp.vec3d],
    spheres: wp.array[Double],
    radius: wp.array[Double],
    trips: wp.array[int],
    depth: wp.array[Double],
):
    i = wp.tid()
    ray = Ray()
    ray.position = origins[i]
    ray.distance = Double(1.0)
    sphere = Sphere()
    sphere.radius = radius[0]
    ray = march_loop(ray, directions[i], spheres, sphere, spheres.shape[0])
    trips[i] = ray.trips
    depth[i] = wp.length(ray.position - origins[i])


@wp.kernel
def net_kernel(params: net.Params, h: wp.array[wp.vec3], x: wp.array[float], n: int, y: wp.array[wp.vec3]):
    i = wp.tid()
    y[i] = net_loop(h[i], params, x, n)


@wp.kernel
def plain_net_kernel(params: net.Params, h: wp.array[wp.vec3], x: wp.array[float], n: int, y: wp.array[wp.vec3]):
    i = wp.tid()
    state = h[i]
    for k in range(n):
        state = recur(state, params, x, k)
    y[i] = state


@wp.kernel
def nested_kernel(factor: wp.array[wp.mat22d], n: int, y: wp.array[wp.mat22d]):
    y[0] = nested_loop(wp.identity(2, Double), factor[0], n)


def array(values, dtype=Double):
    return wp.array(values, dtype=dtype, requires_grad=True)


def gains(n):
    return np.random.default_rng(0).uniform(0.9, 1.05, n)


def test_loops_in_kernels_are_wrong():
    """What `loop` is for, and what `check` is to find: the day Warp mends it both can go."""
    with pytest.raises(ArithmeticError, match=r"wrong gradients of plain_kernel: x: .* by finite differences; rate: "):
        check(plain_kernel, 1, [array([0.3]), array([0.7]), array(gains(5)), 5], [array([0.0])])


def test_every_number_of_trips():
    """Stored in full, on the first level of checkpoints, on both, beyond them; each thread its own number."""
    trips = np.array([0, 1, 2, 3, 4, 5, 15, 16, 17, 33, 100, 257, 300], np.int32)
    x, rate = array(np.linspace(0.1, 1, len(trips))), array(np.linspace(0.2, 0.1, len(trips)))
    y = wp.zeros((2, len(trips)), dtype=Double)
    inputs = [x, rate, array(gains(300)), wp.array(trips)]
    assert check(body_kernel, len(trips), inputs, [y]) < 1e-7
    assert not y.requires_grad and not x.grad.numpy().any()  # as they were
    wp.launch(body_kernel, len(trips), inputs, [y])
    expected = x.numpy()
    for i in range(300):
        expected = np.where(i < trips, np.sin(expected * rate.numpy()) + expected * inputs[2].numpy()[i], expected)
    np.testing.assert_allclose(y.numpy(), [np.exp(0.1 * expected), expected], rtol=1e-12)


def test_structs_and_an_end_by_condition():
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(5, 3)) * 0.1 + [0, 0, 3]
    directions = -origins / np.linalg.norm(origins, axis=1)[:, None]
    trips, depth = wp.zeros(5, dtype=int), array(np.zeros(5))
    inputs = [array(origins, wp.vec3d), array(directions, wp.vec3d), array(np.full(60, 0.99)), array([1.0])]
    wp.launch(march_kernel, 5, inputs, [trips, depth])
    assert trips.numpy().min() > 12 and trips.numpy().max() < 60
    np.testing.assert_allclose(depth.numpy(), np.linalg.norm(origins, axis=1) - 0.99, atol=2e-4)
    assert check(march_kernel, 5, inputs, [trips, depth]) < 1e-5


def test_a_loop_in_a_loop():
    factor = np.array([[[1.1, 0.2], [-0.1, 0.9]]])
    y = array(np.zeros((1, 2, 2)), wp.mat22d)
    assert check(nested_kernel, 1, [array(factor, wp.mat22d), 9], [y]) < 1e-7
    wp.launch(nested_kernel, 1, [array(factor, wp.mat22d), 9], [y])
    np.testing.assert_allclose(y.numpy()[0], np.linalg.matrix_power(factor[0], 36) * 0.5**9, rtol=1e-12)


def test_a_recurrent_network():
    """To its parameters, its first state and what it reads; a loop in the kernel is wrong in all three."""
    rng, net = (
        np.random.default_rng(2),
        wn.MLP(4, 3, width=24, depth=1, precision="float32", activation=wn.activations.tanh, seed=1),
    )
    h, x = array(rng.normal(size=(7, 3)), wp.vec3), array(rng.normal(size=20), float)
    y = array(np.zeros((7, 3)), wp.vec3)
    assert check(net_kernel, 7, [net.params, h, x, 20], [y], update=net.pack) < 2e-3
    with pytest.raises(ArithmeticError, match=r"wrong gradients of plain_net_kernel: .*h: .*; x: "):
        check(plain_net_kernel, 7, [net.params, h, x, 20], [y], update=net.pack)


@wp.func
def no_trip(state: float, rate: float):
    return state * rate


@wp.func
def other_state(state: float, i: int):
    return wp.vec3(state)


@wp.func
def generic(state: wp.Float, i: int):
    return state


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((no_trip,), r"loop of no_trip: expected a function \(state, ..., int\) -> state"),
        ((other_state,), "loop of other_state: expected"),
        ((generic,), "loop of generic: generic or overloaded"),
        ((body, outside), "loop of body: expected of outside the same arguments, and a bool"),
    ],
)
def test_bodies_that_do_not_fit(arguments, message):
    with pytest.raises(wn.InputError, match=message):
        loop(*arguments)


@pytest.mark.parametrize("checkpoints", [0, 3])
def test_checkpoints(checkpoints):
    with pytest.raises(wn.InputError, match=f"checkpoints={checkpoints}: an even number"):
        loop(body, checkpoints=checkpoints)


def test_check_needs_something_to_check():
    with pytest.raises(wn.InputError, match="0 arrays of floats with requires_grad=True in inputs, 1 arrays of floats"):
        check(plain_kernel, 1, [wp.zeros(1, dtype=Double)] * 3 + [1], [array([0.0])])


def test_compiles_for_hopper(tmp_path):
    """All kernels of this file, forwards and backwards."""
    (artifact,) = wp.compile_aot_module(body_kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0
