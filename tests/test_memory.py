"""Vectors to and from rows of memory: whole warps, parts of them, rows in any order, at any alignment."""

from functools import cache

import numpy as np
import pytest
import warp as wp

from warp_neural.coopvec import make_load, make_store


@cache
def make_copy_kernel(n, dtype, block):
    load, store = make_load(n, dtype), make_store(n, dtype)

    @wp.kernel(module="unique", launch_bounds=block)
    def copy_kernel(order: wp.array[int], source: wp.array2d(dtype=dtype), target: wp.array2d(dtype=dtype)):
        i = wp.tid()
        if order[i] < 0:
            return
        store(target, i, load(source, order[i]))

    return copy_kernel


def orders(rows, n):
    """Rows that threads read: their own, with a few threads missing, any, from the last to the first."""
    own = np.arange(n)
    rng = np.random.default_rng(0)
    return [own, np.where(own % 13 == 5, -1, own), rng.integers(0, rows, n), own[::-1]]


@pytest.mark.parametrize("n, dtype", [(32, wp.float16), (24, wp.float32), (136, wp.float16), (5, wp.float32)])
@pytest.mark.parametrize("shift", [0, 1])  # 1: rows that 16 bytes do not divide
@pytest.mark.parametrize("block", [64, 96, 256, 512])
def test_copies_rows(n, dtype, shift, block, device):
    if device.is_cpu and block != 64:
        pytest.skip("blocks are CUDA's")
    rows, launched = 300, 289
    values = np.random.default_rng(1).standard_normal((rows, n + 8)).astype(wp.dtype_to_numpy(dtype))
    whole = wp.array(values, dtype=dtype, device=device, requires_grad=True)
    dy = np.random.default_rng(2).integers(-3, 4, (rows, n)).astype(np.float32)
    for order in orders(rows, launched):
        source = whole[:, shift : shift + n]
        target = wp.zeros((rows, n), dtype=dtype, device=device, requires_grad=True)
        arguments = [wp.array(order, dtype=int, device=device), source]
        whole.grad.zero_()
        with wp.Tape() as tape:
            wp.launch(make_copy_kernel(n, dtype, block), launched, arguments, [target], device=device, block_dim=block)
        active = np.flatnonzero(order >= 0)
        expected = np.zeros((rows, n), values.dtype)
        expected[active] = values[order[active], shift : shift + n]
        np.testing.assert_array_equal(target.numpy(), expected)
        tape.backward(grads={target: wp.array(dy, dtype=dtype, device=device)})
        gradient = np.zeros(values.shape)
        np.add.at(gradient[:, shift : shift + n], order[active], dy[active])
        np.testing.assert_array_equal(whole.grad.numpy(), gradient)
