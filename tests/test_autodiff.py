"""Forward mode against finite differences and reverse mode."""

import importlib.util
import linecache

import numpy as np
import pytest
import warp as wp
import warp.autograd
from generated_functions import generate

import warp_neural as wn
from warp_neural.autodiff import jvp, make_jvp

FUNCTIONS = 50


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    path = tmp_path_factory.mktemp("generated") / "generated.py"
    path.write_text(generate(FUNCTIONS, seed=1))
    spec = importlib.util.spec_from_file_location("generated", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_generated_functions(generated, device):
    """jvp = Jacobian times direction, with Warp's Jacobians by reverse mode and by finite differences, in float64."""
    # run once: what counts is the time to compile; Warp warns of level 0 on CUDA
    wp.set_module_options({"optimization_level": 0 if device.is_cpu else 1}, generated)
    rng = np.random.default_rng(2)
    at = wp.array(rng.uniform(-1, 1, 5), dtype=wp.float64, device=device, requires_grad=True)
    directions = np.vstack([np.eye(5), rng.uniform(-1, 1, (3, 5))])
    values = wp.zeros(FUNCTIONS, dtype=wp.float64, device=device, requires_grad=True)
    launch = {"dim": 1, "inputs": [at], "outputs": [values], "device": device}
    reverse = warp.autograd.jacobian(generated.value_kernel, **launch)[0, 0].numpy()
    differences = warp.autograd.jacobian_fd(generated.value_kernel, **launch, eps=1e-6)[0, 0].numpy()

    d = wp.array(directions, dtype=wp.float64, device=device)
    y, dy = (wp.zeros((len(directions), FUNCTIONS), dtype=wp.float64, device=device) for _ in range(2))
    wp.launch(generated.jvp_kernel, len(directions), inputs=[at, d], outputs=[y, dy], device=device)
    wp.launch(generated.value_kernel, 1, inputs=[at], outputs=[values], device=device)
    np.testing.assert_allclose(y.numpy(), np.broadcast_to(values.numpy(), y.shape), rtol=1e-13)
    assert np.count_nonzero(np.abs(reverse).max(axis=1) > 1e-3) > 0.9 * FUNCTIONS  # the rest are clamped
    np.testing.assert_allclose(dy.numpy(), directions @ reverse.T, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(dy.numpy(), directions @ differences.T, rtol=1e-7, atol=1e-7)


@wp.struct
class Inner:
    scale: float
    counts: wp.array[int]


@wp.struct
class Ray:
    origin: wp.vec3
    direction: wp.vec3
    steps: int
    inner: Inner


@wp.func
def advance(ray: Ray, t: float) -> Ray:
    moved = ray
    moved.origin = ray.origin + t * ray.direction * ray.inner.scale
    moved.steps = ray.steps + ray.inner.counts[1]
    return moved


@wp.func
def distances(ray: Ray, radius: float, centers: wp.array[wp.vec3]):
    nearest = float(1.0e6)
    here = advance(ray, 0.5)
    for i in range(centers.shape[0]):
        d = wp.length(here.origin - centers[i]) - radius
        if d > 100.0:
            continue
        nearest = min(nearest, d)
    return nearest, here, here.steps


def make_ray(origin, direction, scale, device):
    ray = Ray()
    ray.origin, ray.direction, ray.steps, ray.inner.scale = wp.vec3(origin), wp.vec3(direction), 5, scale
    ray.inner.counts = wp.array([1, 2], dtype=int, device=device)
    return ray


def test_structs_arrays_integers_and_several_results(device):
    ray, tangent = make_ray((0, 0, 4), (0, 0, -1), 2.0, device), make_ray((0, 0, 1), (0, 0, 0.5), 3.0, device)
    centers = wp.array([(300, 0, 0), (0, 4, 0), (9, 9, 9)], dtype=wp.vec3, device=device)
    (nearest, here, steps), (d_nearest, d_here, d_steps) = jvp(
        distances, (ray, 1.0, centers), (tangent, 0.25, None), device=device
    )
    # origin + t direction scale = (0, 0, 3); its tangent (0, 0, 1 + 0.5 (0.5 * 2 - 1 * 3)) = (0, 0, 0); length 5
    assert (nearest, tuple(here.origin), steps) == (4.0, (0, 0, 3), 7)
    assert (d_nearest, tuple(d_here.origin), d_steps) == (-0.25, (0, 0, 0), 0)
    assert tuple(d_here.direction) == (0, 0, 0.5) and d_here.inner.scale == 3
    _, (d_nearest, d_here, _) = jvp(
        distances, (ray, 1.0, centers), (make_ray((0, 0, 1), (0,) * 3, 0, device), None, None)
    )
    assert d_nearest == pytest.approx(3 / 5) and tuple(d_here.origin) == (0, 0, 1)


@wp.func
def newton_root(x: wp.float64, tolerance: wp.float64):
    """The square root; early returns and a loop that runs as long as it takes."""
    if x <= wp.float64(0.0):
        return wp.float64(0.0)
    root = x
    while wp.abs(root * root - x) > tolerance:
        root = (root + x / root) / wp.float64(2.0)
    return root


@wp.func
def powers(x: float, n: int):
    y, z = float(1.0), float(0.0)
    for _ in range(n):
        y, z = x * y, y
    return y + 0.0 * z


@wp.func
def scaled(x: float, factor: float = 3.0, shift: float = 1.0):
    return factor * x + shift


@wp.func
def calls(x: float):
    return scaled(x) * scaled(shift=x, x=2.0)


@wp.func
def overwrites(v: wp.vec3):
    w = v * 2.0
    w[0] = v[1]
    w[1] *= v[2]
    return wp.dot(w, w)


@wp.func
def generic_square(x: wp.Float):
    return x * x + wp.sin(x)


@wp.func
def calls_generic(x: wp.float64, y: float):
    return wp.float64(generic_square(y)) + generic_square(x)


def test_loops_of_any_length_swaps_and_early_returns(device):
    value, derivative = jvp(newton_root, (2.0, 1e-14), (1.0, None), device=device)
    assert value == pytest.approx(2**0.5, rel=1e-14) and derivative == pytest.approx(0.5 / 2**0.5, rel=1e-8)
    assert jvp(newton_root, (-1.0, 1e-14), (1.0, None), device=device) == (0.0, 0.0)
    assert jvp(powers, (2.0, 20), (1.0, None), device=device) == (2.0**20, 20 * 2.0**19)  # more trips than are unrolled


def test_components_are_overwritten(device):
    """v1^2 + (2 v1 v2)^2 + (2 v2)^2"""
    at = wp.vec3(7.0, 2.0, 3.0)
    for axis, slope in enumerate([0, 4 + 8 * 2 * 9, 8 * 4 * 3 + 8 * 3]):
        direction = wp.vec3(np.eye(3)[axis])
        assert jvp(overwrites, (at,), (direction,), device=device) == (4 + 144 + 36, slope)


def test_defaults_keywords_and_generic_functions(device):
    assert jvp(calls, (2.0,), (1.0,), device=device) == (56.0, 3 * 8 + 7)  # (3 x + 1) (6 + x)
    value, derivative = jvp(calls_generic, (1.0, 2.0), (1.0, 0.5), device=device)
    expected = 1 + np.sin(1) + 4 + np.sin(2), 2 + np.cos(1) + 0.5 * (4 + np.cos(2))
    assert (value, derivative) == pytest.approx(expected, rel=1e-6)


@wp.func
def chosen(x: float, choice: wp.array[int]):
    return wp.where(choice, x * x, 5.0 * x)


def test_a_choice_by_an_array(device):
    assert jvp(chosen, (3.0, wp.zeros(1, dtype=int, device=device)), (1.0, None)) == (9.0, 6.0)


@wp.func
def cube(x: float):
    return x * x * x


@wp.func
def square(x: float):
    return x * x


def test_sources_stay_apart_when_python_forgets_them(device):
    """Names of generated files were numbers of lines in a cache that anyone may clear."""
    linecache.clearcache()
    first = make_jvp(cube)
    linecache.clearcache()
    make_jvp(square)
    _, (_, second) = jvp(first, (2.0, 1.0), (1.0, None), device=device)
    assert second == 12.0


def test_many_points_at_once(device):
    x = np.linspace(0, 3, 7, dtype=np.float32)
    points = wp.array(x, dtype=float, device=device)
    value, derivative = jvp(calls, (points,), (wp.ones_like(points),))
    np.testing.assert_allclose(value.numpy(), (3 * x + 1) * (6 + x), rtol=1e-6)
    np.testing.assert_allclose(derivative.numpy(), 6 * x + 19, rtol=1e-6)


def test_derivatives_of_derivatives(device):
    """Forward over forward, and reverse over forward."""
    first = make_jvp(generic_or_vector)
    _, (_, second) = jvp(first, (wp.vec3(1, 2, 2), wp.vec3(1, 0, 0)), (wp.vec3(0, 1, 0), None), device=device)
    assert second == pytest.approx(-2 / 27, rel=1e-5)  # d2 |v| / dx dy = -x y / |v|^3
    v = wp.array([(1, 2, 2)], dtype=wp.vec3, device=device, requires_grad=True)
    derivative = wp.zeros(1, dtype=float, device=device, requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(derivative_kernel, 1, inputs=[v], outputs=[derivative], device=device)
    tape.backward(grads={derivative: wp.ones_like(derivative)})
    np.testing.assert_allclose(v.grad.numpy()[0], [8 / 27, -2 / 27, -2 / 27], rtol=1e-5)


@wp.func
def generic_or_vector(v: wp.vec3) -> float:
    return wp.length(wp.max(v, wp.vec3(-100.0)))


length_jvp = make_jvp(generic_or_vector)


@wp.kernel
def derivative_kernel(v: wp.array[wp.vec3], derivative: wp.array[float]):
    _value, tangent = length_jvp(v[0], wp.vec3(1.0, 0.0, 0.0))
    derivative[0] = tangent


@pytest.mark.parametrize(
    ("primals", "tangents", "message"),
    [
        ((1.0, 2), (1.0,), "2 primals and 1 tangents; expected 2 each"),
        ((1.0, 2), (1.0, 1), "argument n has no derivative; its tangent must be None"),
    ],
)
def test_bad_arguments(primals, tangents, message):
    with pytest.raises(wn.InputError, match=message):
        jvp(powers, primals, tangents)


def test_arrays_of_different_lengths(device):
    a, b = (wp.zeros(n, dtype=float, device=device) for n in (2, 3))
    with pytest.raises(wn.InputError, match=r"expected \[n\] for all"):
        jvp(calls, (a,), (b,))


def test_compiles_for_hopper(tmp_path):
    """Forward mode and its reverse."""
    (artifact,) = wp.compile_aot_module(derivative_kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0
