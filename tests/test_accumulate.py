"""Outer products and sums added to gradients in memory, of float32 and float16, exactly equal to NumPy."""

import numpy as np
import pytest
import warp as wp
from products import ROOM, N, choose, positions, small_integers

from warp_neural.coopvec import MatrixSpec, make_outer_product_accumulate, make_reduce_sum_accumulate
from warp_neural.kernels.nn.spec import FORMATS

ROWS, COLUMNS = 20, 33


def make_kernel(spec, gradient_dtype):
    outer_product = make_outer_product_accumulate(spec, gradient_dtype)
    reduce_sum = make_reduce_sum_accumulate(spec.rows, spec.dtype, gradient_dtype)
    vec_a, vec_b, target = spec.vec_out, spec.vec_in, wp.array(dtype=gradient_dtype)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(
        a: wp.array[vec_a],
        b: wp.array[vec_b],
        divergence: int,
        stride: int,
        shift: int,
        weights: target,
        biases: target,
    ):
        i = wp.tid()
        if divergence == 2 and i % 4 == 0:
            return
        which = int(0)
        if divergence == 1:
            which = i * 7 % 3
        outer_product(a[i], b[i], weights, which * wp.static(ROOM) + shift, stride)
        reduce_sum(a[i], biases, which * wp.static(spec.rows) + shift)

    return kernel


def launch(spec, a, b, weights, biases, divergence=0, stride=0, shift=0):
    vectors = [
        wp.array(values.astype(wp.dtype_to_numpy(spec.dtype)), dtype=kind, device=weights.device)
        for values, kind in ((a, spec.vec_out), (b, spec.vec_in))
    ]
    arguments = [*vectors, divergence, stride, shift, weights, biases]
    wp.launch(make_kernel(spec, weights.dtype), len(a), arguments, device=weights.device)


@pytest.mark.parametrize("gradient_dtype", [wp.float32, wp.float16])
@pytest.mark.parametrize("precision, dtype", [
    ("float32", wp.float32), ("float16", wp.float32), ("float16", wp.float16), ("bfloat16", wp.float32),
    ("e4m3", wp.float16),
])  # fmt: skip
@pytest.mark.parametrize("layout", ["row_major", "column_major", "training_optimal"])
def test_accumulating_operations_are_exact(layout, precision, dtype, gradient_dtype, device):
    """Whole warps, several targets in a warp, missing lanes; also where no two elements share an aligned word."""
    spec, rng = MatrixSpec(ROWS, COLUMNS, precision, layout, dtype=dtype), np.random.default_rng(2)
    a, b = small_integers(rng, N, ROWS), small_integers(rng, N, COLUMNS)
    for divergence, shift in np.ndindex(3, 2):
        which, active = choose(divergence)
        weights, biases = (wp.zeros(3 * n + 1, dtype=gradient_dtype, device=device) for n in (ROOM, ROWS))
        launch(spec, a, b, weights, biases, divergence, shift=shift)
        place = positions(layout, FORMATS[precision], ROWS, COLUMNS)
        weights, biases = (array.numpy()[shift:] for array in (weights, biases))
        result = weights[: 3 * ROOM].reshape(3, ROOM)
        for m in range(3):
            mine = (which == m) & active
            np.testing.assert_array_equal(result[m, place], a[mine].T @ b[mine])
            np.testing.assert_array_equal(biases[: 3 * ROWS].reshape(3, ROWS)[m], a[mine].sum(0))
            assert np.count_nonzero(result[m]) == np.count_nonzero(result[m, place])  # nothing elsewhere


@pytest.mark.parametrize("stride", [33, 34, 35])
def test_rows_a_stride_apart(stride, device):
    """In float16, pairs of elements begin at either half of a word."""
    spec, rng = MatrixSpec(5, 33, "float16", "row_major", dtype=wp.float16), np.random.default_rng(3)
    a, b = small_integers(rng, 64, 5), small_integers(rng, 64, 33)
    weights, biases = (wp.zeros(n, dtype=wp.float16, device=device) for n in (5 * stride, 5))
    launch(spec, a, b, weights, biases, stride=stride)
    expected = np.pad(a.T @ b, ((0, 0), (0, stride - 33)))
    np.testing.assert_array_equal(weights.numpy().reshape(5, stride), expected)


def test_float16_rounds_each_addition(device):
    """Threads without a whole warp add one by one: 2048 takes no ones, to nearest even, and 65504 takes no more."""
    spec, n = MatrixSpec(3, 2, "float16", "row_major", dtype=wp.float16), 8
    a, b = np.tile([1.0, 3.0, 16.0], (n, 1)), np.ones((n, 2))
    starts = np.array([2048.0, 2048.0, 65504.0])
    weights = wp.array(np.repeat(starts, 2), dtype=wp.float16, device=device)
    biases = wp.array(starts, dtype=wp.float16, device=device)
    launch(spec, a, b, weights, biases)
    for start, value, result in zip(starts, a[0], biases.numpy(), strict=True):
        expected = np.float16(start)
        with np.errstate(over="ignore"):
            for _ in range(n):
                expected += np.float16(value)
        assert result == expected
    np.testing.assert_array_equal(weights.numpy(), np.repeat(biases.numpy(), 2))
    assert biases.numpy()[0] == 2048 and np.isinf(biases.numpy()[2])


def test_the_cpu_adds_in_order():
    """Bit for bit what NumPy's float16 gives, thread by thread."""
    spec, rng = MatrixSpec(7, 5, "float16", "row_major", dtype=wp.float16), np.random.default_rng(4)
    a, b = rng.normal(size=(N, 7)).astype(np.float16), rng.normal(size=(N, 5)).astype(np.float16)
    weights, biases = (wp.zeros(n, dtype=wp.float16, device="cpu") for n in (35, 7))
    launch(spec, a, b, weights, biases)
    sums, products = np.zeros(7, np.float16), np.zeros((7, 5), np.float16)
    for i in range(N):
        sums, products = sums + a[i], products + a[i][:, None] * b[i]
    np.testing.assert_array_equal(biases.numpy(), sums)
    np.testing.assert_array_equal(weights.numpy().reshape(7, 5), products)


REFUSED = [
    (lambda: make_outer_product_accumulate(MatrixSpec(4, 4, "int8")), "floating-point precision"),
    (lambda: make_outer_product_accumulate(MatrixSpec(4, 4, "e4m3", dtype=wp.uint32)), "dtype=.*: expected wp.float32"),
    (lambda: make_outer_product_accumulate(MatrixSpec(4, 4), wp.float64), "gradient_dtype=.*: expected wp.float32"),
    (lambda: make_reduce_sum_accumulate(4, wp.float32, int), "gradient_dtype=.*: expected wp.float32"),
]


@pytest.mark.parametrize("call, message", REFUSED)
def test_refuses(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("layout", ["column_major", "training_optimal"])
def test_half_gradients_compile_for_hopper(layout, tmp_path):
    kernel = make_kernel(MatrixSpec(ROWS, COLUMNS, "float16", layout, dtype=wp.float16), wp.float16)
    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0
