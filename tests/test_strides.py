"""Views with any strides: every native function that takes an array reads and writes what NumPy would."""

import numpy as np
import pytest
import warp as wp
from networks import evaluate, random_biases, samples
from products import bias_buffer, matrix_buffer, small_integers

import warp_neural as wn
from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.coopvec.operations import (
    MatrixSpec,
    make_matmul_add,
    make_outer_product_accumulate,
    make_reduce_sum_accumulate,
)

VIEWS = {
    "whole": lambda w: w,
    "every other": lambda w: w[:, ::2],
    "shifted": lambda w: w[:, 1::3],
    "transposed": lambda w: w.transpose(),
    "of a transposed": lambda w: w.transpose()[::2, 3:],
    "rows": lambda w: w[3::5],
}
views = pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
DTYPES = {wp.float16: np.float16, wp.float32: np.float32}
SIDE = 96


def square(dtype, device):
    values = small_integers(np.random.default_rng(0), SIDE, SIDE)
    return wp.array(values, dtype=dtype, device=device, requires_grad=True)


@views
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("n", [3, 32])
def test_loads_and_stores(view, dtype, n, device):
    """Forward and back: what lies between the elements of a view stays as it is. Views are of NumPy as of Warp."""
    load, store = make_load(n, dtype), make_store(n, dtype)

    @wp.kernel(module="unique")
    def copy_kernel(source: wp.array2d[dtype], target: wp.array2d[dtype]):
        i = wp.tid()
        store(target, i, load(source, i))

    source, target = square(dtype, device), square(dtype, device)
    a, b = view(source), view(target)
    expected, gradient = target.numpy(), np.zeros((SIDE, SIDE), DTYPES[dtype])
    at = view(np.arange(SIDE * SIDE).reshape(SIDE, SIDE))[:, :n]
    expected.ravel()[at] = source.numpy().ravel()[at]
    dy = small_integers(np.random.default_rng(1), SIDE, SIDE)
    with wp.Tape() as tape:
        wp.launch(copy_kernel, a.shape[0], [a, b], device=device)
    np.testing.assert_array_equal(target.numpy(), expected)
    target.grad.assign(dy.astype(DTYPES[dtype]))
    tape.backward()
    gradient.ravel()[at] = dy.ravel()[at]
    np.testing.assert_array_equal(source.grad.numpy(), gradient)


@views
@pytest.mark.parametrize("precision, dtype", [("float32", wp.float32), ("float16", wp.float16)])
@pytest.mark.parametrize("n_in", [3, 16])
def test_evaluate_and_of_row(view, precision, dtype, n_in, device):
    net = random_biases(wn.MLP(n_in, 2, 16, 1, precision=precision, dtype=dtype, device=device))
    whole = wp.array(samples(SIDE, SIDE), dtype=dtype, device=device)
    x = view(whole)[:, :n_in]
    expected = evaluate(net, x.numpy()).y
    np.testing.assert_array_equal(net.evaluate(x).numpy(), expected)
    np.testing.assert_array_equal(net.evaluate(x.numpy()[::-1]).numpy(), expected[::-1])


@pytest.mark.parametrize("precision", ["float16", "e4m3", "float32"])
@pytest.mark.parametrize("apart", [2, 3])
def test_products_of_words_that_lie_apart(precision, apart, device):
    spec = MatrixSpec(20, 33, precision)
    product, vec_in, vec_out = make_matmul_add(spec), spec.vec_in, spec.vec_out

    @wp.kernel(module="unique")
    def kernel(
        x: wp.array[vec_in], matrix: wn.coopvec.Buffer, bias: wn.coopvec.Buffer, y: wp.array[vec_out]
    ):  # fmt: skip
        i = wp.tid()
        y[i] = product(x[i], matrix, 0, 0, bias, 16)

    rng = np.random.default_rng(0)
    values, biases = small_integers(rng, 1, 20, 33), small_integers(rng, 1, 24)
    x_values, dy = small_integers(rng, 64, 33), small_integers(rng, 64, 20)
    results = []
    for spread in (lambda array: array, lambda array: spaced(array, apart)):
        matrix, bias = matrix_buffer(values, spec.layout, spec.format, device), bias_buffer(biases, device)
        for buffer in (matrix, bias):
            buffer.data, buffer.gradient = spread(buffer.data), spread(buffer.gradient)
        x = wp.array(x_values, dtype=vec_in, device=device, requires_grad=True)
        y = wp.zeros(64, dtype=vec_out, device=device, requires_grad=True)
        with wp.Tape() as tape:
            wp.launch(kernel, 64, [x, matrix, bias], [y], device=device)
        tape.backward(grads={y: wp.array(dy, dtype=vec_out, device=device)})
        results.append([a.numpy() for a in (y, x.grad, matrix.gradient, bias.gradient)])
    np.testing.assert_array_equal(results[0][0], x_values @ values[0].T + biases[0, 4:])
    for dense, apart_ in zip(*results, strict=True):
        np.testing.assert_array_equal(apart_, dense)


def spaced(array, apart):
    """The same numbers, `apart` elements from each other."""
    room = wp.full(array.size * apart, 7, dtype=array.dtype, device=array.device)
    view = room[::apart]
    view.assign(array)
    return view


@pytest.mark.parametrize("dtype", DTYPES)
def test_sums_into_views(dtype, device):
    spec = MatrixSpec(16, 16, "float16", "row_major")
    outer, reduce = make_outer_product_accumulate(spec, dtype), make_reduce_sum_accumulate(16, wp.float32, dtype)
    vec = spec.vec_in

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(a: wp.array[vec], b: wp.array[vec], products: wp.array[dtype], sums: wp.array[dtype]):
        i = wp.tid()
        outer(a[i], b[i], products, 2, 0)
        reduce(a[i], sums, 3)

    a, b = (small_integers(np.random.default_rng(seed), 64, 16) for seed in (0, 1))
    products, sums = wp.zeros(3 * 300, dtype=dtype, device=device), wp.zeros(2 * 30, dtype=dtype, device=device)
    arrays = [wp.array(x, dtype=vec, device=device) for x in (a, b)]
    wp.launch(kernel, 64, [*arrays, products[1::3], sums[::2]], device=device)
    expected, totals = np.zeros(900), np.zeros(60)
    expected[1::3][2:258], totals[::2][3:19] = (a.T @ b).ravel(), a.sum(0)
    np.testing.assert_array_equal(products.numpy(), expected)
    np.testing.assert_array_equal(sums.numpy(), totals)
