"""Products of cooperative vectors and their adjoints: equal to NumPy in any layout, of any types, under divergence."""

import numpy as np
import pytest
import warp as wp
from products import ROOM, N, bias_buffer, choose, matrix_buffer, positions, small_integers, vectors

from warp_neural.kernels.coopvec.operations import Buffer, MatrixSpec, make_matmul, make_matmul_add
from warp_neural.kernels.coopvec.product_types import product_types
from warp_neural.kernels.nn.spec import FORMATS

ROWS, COLUMNS = 20, 33
CASES = [(ROWS, COLUMNS, f, layout) for f in FORMATS for layout in ("inferencing_optimal", "row_major")]
CASES += [(COLUMNS, ROWS, "float16", layout, True) for layout in ("column_major", "training_optimal")]
CASES += [(COLUMNS, ROWS, f, "inferencing_optimal", True) for f in ("float16", "e4m3", "int8")]
SPECS = [MatrixSpec(*case) for case in CASES]
for name, format in FORMATS.items():  # every combination of types
    for accumulation, dtype, result, bias in product_types(format):
        SPECS.append(MatrixSpec(ROWS, COLUMNS, name, "inferencing_optimal", False, dtype, accumulation, bias, result))


def describe(spec):
    """A test's name."""
    types = spec.dtype.__name__, spec.precision, spec.accumulation, spec.bias, spec.result.__name__
    return "-".join((*types, spec.layout, *(["transposed"] if spec.transpose else [])))


@pytest.mark.parametrize("spec", dict.fromkeys(SPECS), ids=describe)
def test_matmul_add_and_its_adjoint_are_exact(spec, device):
    matmul_add, vec_in, vec_out = make_matmul_add(spec), spec.vec_in, spec.vec_out
    rows, columns, format, transpose = spec.rows, spec.columns, spec.format, spec.transpose
    bias_bytes = np.dtype(spec.bias).itemsize * rows

    @wp.kernel(module="unique")
    def kernel(
        x: wp.array[vec_in], matrix: Buffer, bias: Buffer, divergence: int, size: int, y: wp.array[vec_out]
    ):  # fmt: skip
        i = wp.tid()
        if divergence == 2 and i % 4 == 0:
            return
        which = int(0)
        if divergence == 1:
            which = i * 7 % 3
        y[i] = matmul_add(x[i], matrix, which * size, 0, bias, which * bias_bytes)

    rng = np.random.default_rng(0)
    stored = small_integers(rng, 3, *((columns, rows) if transpose else (rows, columns)))
    matrices = stored.transpose(0, 2, 1) if transpose else stored
    biases, x_values, dy = small_integers(rng, 3, rows), small_integers(rng, N, columns), small_integers(rng, N, rows)
    for divergence in range(3):
        which, active = choose(divergence)
        matrix, bias = matrix_buffer(stored, spec.layout, format, device), bias_buffer(biases, device, spec.bias)
        x = vectors(spec, x_values, device)
        y = wp.zeros(N, dtype=vec_out, device=device, requires_grad=True)
        with wp.Tape() as tape:
            size = ROOM * format.bits // 8
            wp.launch(kernel, N, inputs=[x, matrix, bias, divergence, size], outputs=[y], device=device)
        tape.backward(grads={y: wp.array(dy.astype(y.numpy().dtype), dtype=vec_out, device=device)})
        expected = np.einsum("inj,ij->in", matrices[which], x_values) + biases[which]
        np.testing.assert_array_equal(y.numpy(), expected * active[:, None])
        smooth = spec.result is not wp.int32  # whole numbers have no gradients
        if spec.dtype in (wp.float32, wp.float16):
            dx = np.einsum("inj,in->ij", matrices[which], dy) * active[:, None]
            np.testing.assert_array_equal(x.grad.numpy(), smooth * dx)
        gradient = matrix.gradient.numpy().reshape(3, ROOM)[:, positions(spec.layout, format, *stored.shape[1:])]
        for m in range(3):
            mine = (which == m) & active
            outer = smooth * dy[mine].T @ x_values[mine]
            np.testing.assert_array_equal(gradient[m], outer.T if transpose else outer)
            np.testing.assert_array_equal(bias.gradient.numpy().reshape(3, rows)[m], smooth * dy[mine].sum(0))


def test_matmul_reads_rows_a_stride_apart(device):
    spec = MatrixSpec(5, 7, "float16", "row_major")
    matmul, vec_in, vec_out = make_matmul(spec), spec.vec_in, spec.vec_out

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(x: wp.array[vec_in], matrix: Buffer, y: wp.array[vec_out]):
        i = wp.tid()
        y[i] = matmul(x[i], matrix, 16, 24)

    rng = np.random.default_rng(1)
    matrix, x = small_integers(rng, 5, 7), small_integers(rng, 64, 7)
    storage = np.full(8 + 5 * 12, np.nan, np.float16)  # 16 bytes before, rows 24 bytes apart
    storage[8:].reshape(5, 12)[:, :7] = matrix
    buffer = Buffer()
    buffer.data = wp.array(storage.view(np.uint32), dtype=wp.uint32, device=device)
    buffer.gradient = wp.zeros(0, dtype=float, device=device)
    y = wp.zeros(64, dtype=vec_out, device=device)
    x_array = wp.array(x.astype(np.float32), dtype=vec_in, device=device)
    wp.launch(kernel, 64, inputs=[x_array, buffer], outputs=[y], device=device)
    np.testing.assert_array_equal(y.numpy(), x @ matrix.T)
