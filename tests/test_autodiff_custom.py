"""Custom forward derivatives, what has none, what debug_grad shows, and the sample."""

import numpy as np
import pytest
import warp as wp

import warp_neural as wn
from warp_neural.autodiff import check_finite, debug_grad, jvp, make_jvp
from warp_neural.imaging.image import load_image
from warp_neural.samples.autodiff import __main__ as sample
from warp_neural.samples.autodiff import step_05_normals


@wp.func_native("return x * x;", adj_snippet="adj_x += 2.0f * x * adj_ret;")
def native_square(x: float) -> float: ...


@wp.func
def calls_native(x: float, n: int):
    return 2.0 * native_square(x) + float(n)


@wp.func
def unsupported(x: float):
    y = x * 2.0
    return wp.noise(wp.uint32(1), y)


@wp.func
def writes(m: wp.mat33):
    q = wp.mat33()
    r = wp.mat33()
    wp.qr3(m, q, r)
    return r


@wp.func
def double(x: wp.ref[float], y: float):
    x += 2.0 * y


@wp.func
def writes_by_reference(x: float):
    y = float(0.0)
    double(y, x)
    return y


@wp.func
def no_result(a: wp.array[float], x: float):
    a[0] = x


@wp.func
def only_integers(n: int):
    return 2 * n


@pytest.mark.parametrize(
    ("func", "message"),
    [
        (
            unsupported,
            r"jvp of unsupported: `wp.noise\(wp.uint32\(1\), y\)`: no forward derivative of wp.noise is known",
        ),
        (
            writes,
            r"jvp of writes: `wp.qr3\(m, q, r\)`: wp.qr3 writes to its arguments, which forward mode does not follow",
        ),
        (writes_by_reference, r"jvp of writes_by_reference: `double\(y, x\)`: double writes to its arguments"),
        (calls_native, "jvp of native_square: native code has no forward derivative; register"),
        (no_result, "no_result: it returns nothing"),
        (only_integers, "only_integers: none of its arguments"),
        (abs, "expected a function decorated with @wp.func"),
    ],
)
def test_what_cannot_be_followed_is_named(func, message):
    with pytest.raises(wn.InputError, match=message):
        make_jvp(func)


@wp.func_native("return x * x;")
def registered(x: float, n: int) -> float: ...


@wp.func
def calls_registered(x: float):
    return 2.0 * registered(3.0 * x, 7)


def test_a_registered_derivative_is_used(device):
    """Even where it is not the derivative; through native code, and in functions that call it."""

    @wn.autodiff.forward_derivative(registered)
    @wp.func
    def registered_forward(x: float, n: int, dx: float):
        return registered(x, n), 100.0 * dx

    assert make_jvp(registered) is registered_forward
    assert jvp(registered, (3.0, 1), (1.0, None), device=device) == (9.0, 100.0)
    assert jvp(calls_registered, (1.0,), (1.0,), device=device) == (18.0, 600.0)


def test_a_registered_derivative_has_the_right_arguments():
    with pytest.raises(wn.InputError, match=r"it takes 1 arguments; expected 3"):
        wn.autodiff.forward_derivative(calls_native)(only_integers)


@wp.kernel
def debug_kernel(
    x: wp.array[float], v: wp.array[wp.vec3], at_x: wp.array[float], at_v: wp.array[wp.vec3], y: wp.array[float]
):
    i = wp.tid()
    root = wp.sqrt(debug_grad(x[i], at_x, i))
    y[i] = 3.0 * root + debug_grad(debug_grad(v[i], at_v, 0)[1] * 2.0)


def test_debug_grad(device, capfd):
    x = wp.array([4.0, 1.0, 0.0], dtype=float, device=device, requires_grad=True)
    v, y = wp.ones(3, dtype=wp.vec3, device=device, requires_grad=True), wp.zeros_like(x)
    at_x, at_v = wp.zeros(3, dtype=float, device=device), wp.zeros(1, dtype=wp.vec3, device=device)
    with wp.Tape() as tape:
        wp.launch(debug_kernel, 3, inputs=[x, v, at_x, at_v], outputs=[y], device=device)
    tape.backward(grads={y: wp.full(3, 5.0, dtype=float, device=device)})
    wp.synchronize_device(device)
    assert capfd.readouterr().out.split() == ["5"] * 3  # printed where the gradient of y passes unchanged
    np.testing.assert_allclose(y.numpy(), [8, 5, 2])
    np.testing.assert_allclose(at_x.numpy(), [3.75, 7.5, np.inf])
    np.testing.assert_array_equal(at_x.numpy(), x.grad.numpy())
    np.testing.assert_allclose(v.grad.numpy(), [[0, 10, 0]] * 3)
    np.testing.assert_allclose(at_v.numpy(), [[0, 30, 0]])  # several threads, one entry: their sum
    check_finite(at_v)
    with pytest.raises(FloatingPointError, match=r"gradient 2 is inf; 1 of 3 are not finite"):
        check_finite(at_x)


def test_compiles_for_hopper(tmp_path):
    """debug_grad in all its forms."""
    (artifact,) = wp.compile_aot_module(debug_kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_sample(device, tmp_path, capsys):
    metrics = sample.main(step_05_normals.Config(device=device.alias, out=tmp_path, size=64))
    exact = {"forward_1_1": 14, "forward_1_0": 6, "forward_0_1": 8, "backward_x": 6, "backward_y": 8, "debug_grad": 1}
    assert {key: metrics[key] for key in exact} == exact
    assert metrics["normal_degrees_forward"] < 1e-4 < 1e-3 < metrics["normal_degrees_h_0.0001"]
    assert metrics["normal_degrees_float64"] < 1e-6
    assert "6·1 + 8·1 = 14" in capsys.readouterr().out
    assert load_image(tmp_path / "normals.png").std() > 0.1


def test_sample_size(tmp_path):
    with pytest.raises(wn.InputError, match="--size 4: give 8 to 4096"):
        step_05_normals.main(step_05_normals.Config(device="cpu", out=tmp_path, size=4))
