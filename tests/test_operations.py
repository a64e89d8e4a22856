"""The four cooperative-vector operations: small integers, exactly equal to NumPy, in every layout, under divergence."""

import numpy as np
import pytest
import warp as wp

from warp_neural.kernels.coopvec.formats import make_encode
from warp_neural.kernels.coopvec.operations import (
    Buffer,
    MatrixSpec,
    make_matmul,
    make_matmul_add,
    make_outer_product_accumulate,
    make_reduce_sum_accumulate,
)
from warp_neural.kernels.nn.spec import BFLOAT16, E4M3, E5M2, FLOAT16, FLOAT32, INT8, TF32

N, ROWS, COLUMNS, ROOM = 77, 20, 33, 4096  # threads (no multiple of 32), matrix size, elements set aside for a matrix
FORMATS = [FLOAT32, TF32, FLOAT16, BFLOAT16, E4M3, E5M2, INT8]
ids = lambda value: getattr(value, "name", str(value))  # noqa: E731


def positions(layout, format, rows, columns):
    """[rows, columns] element positions in a buffer, by walking the buffer in the order that the lanes load it."""
    place = np.full((rows + 64, columns + 64), -1)
    if layout == "row_major" or (layout == "inferencing_optimal" and format is FLOAT32):
        pitch = columns if layout == "row_major" else -(-columns // 4) * 4
        return np.arange(rows)[:, None] * pitch + np.arange(columns)
    if layout == "column_major":
        return np.arange(columns)[None, :] * rows + np.arange(rows)[:, None]
    at = 0
    if layout == "training_optimal":
        for tile_n in range(0, rows, 16):
            for tile_k in range(0, columns, 8):
                for lane in range(32):
                    for half in (0, 8):
                        for odd in (0, 1):
                            place[tile_n + half + lane // 4, tile_k + lane % 4 * 2 + odd] = at
                            at += 1
        return place[:rows, :columns]
    blocks = -(-columns // format.k_step)
    columns_of = {16: (0, 1), 8: (0, 1, 8, 9), 32: (0,)}[format.bits]
    for tile_n in range(0, rows, 8):
        for pair in range(0, blocks, 2):
            for lane in range(32):
                for block in (pair, pair + 1):
                    for register in (0, 1):
                        first = block * format.k_step + lane % 4 * 2
                        first += register if format is TF32 else register * format.k_step // 2
                        for offset in columns_of:
                            if first + offset < place.shape[1]:
                                place[tile_n + lane // 4, first + offset] = at
                            at += 1
    return place[:rows, :columns]


def encoded(format, values):
    """Bits of each value, as unsigned integers of the format's width."""
    encode = make_encode(format)

    @wp.kernel(module="unique", enable_backward=False)
    def encode_kernel(x: wp.array[float], y: wp.array[wp.uint32]):
        i = wp.tid()
        y[i] = encode(x[i])

    bits = wp.zeros(values.size, dtype=wp.uint32, device="cpu")
    x = wp.array(values.astype(np.float32).ravel(), dtype=float, device="cpu")
    wp.launch(encode_kernel, values.size, inputs=[x], outputs=[bits], device="cpu")
    return bits.numpy().astype({8: np.uint8, 16: np.uint16, 32: np.uint32}[format.bits]).reshape(values.shape)


def matrix_buffer(matrices, layout, format, device):
    """A Buffer of several matrices, ROOM elements apart, with room for gradients."""
    data = np.zeros((len(matrices), ROOM), encoded(format, np.zeros(1)).dtype)
    for matrix, row in zip(matrices, data, strict=True):
        row[positions(layout, format, *matrix.shape)] = encoded(format, matrix)
    buffer = Buffer()
    buffer.data = wp.array(data.view(np.uint32).ravel(), dtype=wp.uint32, device=device)
    buffer.gradient = wp.zeros(data.size, dtype=float, device=device)
    return buffer


def bias_buffer(biases, device):
    buffer = Buffer()
    buffer.data = wp.array(biases.astype(np.float32).view(np.uint32).ravel(), dtype=wp.uint32, device=device)
    buffer.gradient = wp.zeros(biases.size, dtype=float, device=device)
    return buffer


def small_integers(rng, *shape):
    return rng.integers(-3, 4, shape).astype(np.float64)


def choose(divergence):
    """(matrix of each thread, which threads take part): all alike, three matrices interleaved, a quarter returned."""
    threads = np.arange(N)
    return threads * 7 % 3 if divergence == 1 else threads * 0, threads % 4 != 0 if divergence == 2 else threads >= 0


CASES = [(f, layout, False, "float32") for f in FORMATS for layout in ("inferencing_optimal", "row_major")]
CASES += [(FLOAT16, layout, True, "float32") for layout in ("inferencing_optimal", "column_major", "training_optimal")]
CASES += [(f, "inferencing_optimal", True, "float16") for f in (FLOAT16, E4M3)]


@pytest.mark.parametrize("format, layout, transpose, accumulation", CASES, ids=ids)
def test_matmul_add_and_its_adjoint_are_exact(format, layout, transpose, accumulation, device):
    spec = MatrixSpec(ROWS, COLUMNS, format.name, layout, transpose, accumulation=accumulation)
    matmul_add, vec_in, vec_out = make_matmul_add(spec), spec.vec_in, spec.vec_out

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
        y[i] = matmul_add(x[i], matrix, which * size, 0, bias, which * wp.static(4 * ROWS))

    rng = np.random.default_rng(0)
    stored = small_integers(rng, 3, *((COLUMNS, ROWS) if transpose else (ROWS, COLUMNS)))
    matrices = stored.transpose(0, 2, 1) if transpose else stored
    biases, x_values, dy = small_integers(rng, 3, ROWS), small_integers(rng, N, COLUMNS), small_integers(rng, N, ROWS)
    for divergence in range(3):
        which, active = choose(divergence)
        matrix, bias = matrix_buffer(stored, layout, format, device), bias_buffer(biases, device)
        x = wp.array(x_values.astype(np.float32), dtype=vec_in, device=device, requires_grad=True)
        y = wp.zeros(N, dtype=vec_out, device=device, requires_grad=True)
        with wp.Tape() as tape:
            size = ROOM * format.bits // 8
            wp.launch(kernel, N, inputs=[x, matrix, bias, divergence, size], outputs=[y], device=device)
        tape.backward(grads={y: wp.array(dy.astype(np.float32), dtype=vec_out, device=device)})
        expected = np.einsum("inj,ij->in", matrices[which], x_values) + biases[which]
        np.testing.assert_array_equal(y.numpy(), expected * active[:, None])
        np.testing.assert_array_equal(x.grad.numpy(), np.einsum("inj,in->ij", matrices[which], dy) * active[:, None])
        gradient = matrix.gradient.numpy().reshape(3, ROOM)[:, positions(layout, format, *stored.shape[1:])]
        for m in range(3):
            mine = (which == m) & active
            outer = dy[mine].T @ x_values[mine]
            np.testing.assert_array_equal(gradient[m], outer.T if transpose else outer)
            np.testing.assert_array_equal(bias.gradient.numpy().reshape(3, ROWS)[m], dy[mine].sum(0))


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


@pytest.mark.parametrize("format", [FLOAT32, FLOAT16, BFLOAT16, E4M3], ids=ids)
@pytest.mark.parametrize("layout", ["row_major", "training_optimal"])
def test_accumulating_operations_are_exact(format, layout, device):
    spec = MatrixSpec(ROWS, COLUMNS, format.name, layout)
    outer_product, reduce_sum = make_outer_product_accumulate(spec), make_reduce_sum_accumulate(ROWS, wp.float32)
    vec_a, vec_b = spec.vec_out, spec.vec_in

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(
        a: wp.array[vec_a], b: wp.array[vec_b], divergence: int, weights: wp.array[float], biases: wp.array[float]
    ):  # fmt: skip
        i = wp.tid()
        if divergence == 2 and i % 4 == 0:
            return
        which = int(0)
        if divergence == 1:
            which = i * 7 % 3
        outer_product(a[i], b[i], weights, which * wp.static(ROOM), 0)
        reduce_sum(a[i], biases, which * wp.static(ROWS))

    rng = np.random.default_rng(2)
    a, b = small_integers(rng, N, ROWS), small_integers(rng, N, COLUMNS)
    for divergence in range(3):
        which, active = choose(divergence)
        weights, biases = (wp.zeros(3 * n, dtype=float, device=device) for n in (ROOM, ROWS))
        vectors = [wp.array(v.astype(np.float32), dtype=t, device=device) for v, t in ((a, vec_a), (b, vec_b))]
        wp.launch(kernel, N, inputs=[*vectors, divergence], outputs=[weights, biases], device=device)
        result = weights.numpy().reshape(3, ROOM)[:, positions(layout, format, ROWS, COLUMNS)]
        for m in range(3):
            mine = (which == m) & active
            np.testing.assert_array_equal(result[m], a[mine].T @ b[mine])
            np.testing.assert_array_equal(biases.numpy().reshape(3, ROWS)[m], a[mine].sum(0))


def test_outer_product_of_int8_is_refused():
    with pytest.raises(ValueError, match="floating-point precision"):
        make_outer_product_accumulate(MatrixSpec(4, 4, "int8"))
