"""Products of int8 with int32 biases and results, over the whole range of both, and packed vectors: bit for bit."""

import numpy as np
import pytest
import reference_networks as reference
import warp as wp
from products import N, bias_buffer, choose, matrix_buffer

from warp_neural.coopvec import convert_matrix, matrix_size
from warp_neural.kernels.coopvec.convert import LAYOUTS
from warp_neural.kernels.coopvec.operations import Buffer, MatrixSpec, make_matmul, make_matmul_add

SIZES = [(1, 1), (7, 16), (16, 7), (33, 1), (1, 33), (33, 16), (256, 33), (7, 256)]  # rows, columns
VECTORS = [wp.int8, wp.uint32, wp.float32, wp.float16]


def make_kernel(spec):
    matmul, matmul_add, vec_in, vec_out = make_matmul(spec), make_matmul_add(spec), spec.vec_in, spec.vec_out

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(
        x: wp.array[vec_in],
        matrix: Buffer,
        size: int,
        bias: Buffer,
        divergence: int,
        product: wp.array[vec_out],
        sums: wp.array[vec_out],
    ):
        i = wp.tid()
        if divergence == 2 and i % 4 == 0:
            return
        which = int(0)
        if divergence == 1:
            which = i * 7 % 3
        product[i] = matmul(x[i], matrix, which * size, 0)
        sums[i] = matmul_add(x[i], matrix, which * size, 0, bias, which * wp.static(4 * spec.rows))

    return kernel


def numbers(rng, *shape):
    """Of 8 bits, all of them as likely; some rows of the largest sums that there are."""
    values = rng.integers(-128, 128, shape)
    values[0], values[-1] = -128, 127
    return values


def vectors(spec, values, rng, device):
    """Vectors that the product of `spec` rounds to `values`."""
    if spec.dtype is wp.uint32:
        padded = np.pad(values, ((0, 0), (0, -values.shape[1] % 4)), constant_values=0x55).astype(np.int8)
        return wp.array(padded.view(np.uint32), dtype=spec.vec_in, device=device)
    if spec.dtype is not wp.int8:
        values = values + rng.choice([-0.25, 0.0, 0.25], values.shape)  # exact in float16
        values = np.where(rng.integers(0, 2, values.shape) == 1, values, saturated_or_ties(values))
    return wp.array(values.astype(wp.dtype_to_numpy(spec.dtype)), dtype=spec.vec_in, device=device)


def saturated_or_ties(values):
    """Other numbers that round to the same: beyond the range, or half way to an even one."""
    nearest = np.rint(values)
    other = np.where(nearest % 2 == 0, nearest + np.where(values > nearest, 0.5, -0.5), nearest)
    return np.where(nearest <= -128, -3e4, np.where(nearest >= 127, 6e4, other))


def buffers(stored, layout, device):
    """Three matrices as `convert_matrix` lays them out, a matrix's size in bytes."""
    rows, columns = stored.shape[1:]
    size = matrix_size(rows, columns, "int8", layout)
    data = np.zeros(3 * size // 4, np.uint32)
    for i, matrix in enumerate(stored.astype(np.int8)):
        convert_matrix(matrix, rows, columns, "int8", "row_major", "int8", layout, target=data, target_offset=i * size)
    matrix = Buffer()
    matrix.data = wp.array(data, dtype=wp.uint32, device=device)
    matrix.gradient = wp.zeros(0, dtype=float, device=device)
    return matrix, size


@pytest.mark.parametrize("dtype", VECTORS)
@pytest.mark.parametrize("rows, columns", SIZES)
def test_sums_are_those_of_int32(rows, columns, dtype, device):
    """Whole warps, several matrices in a warp, missing lanes; sums past int32 wrap around, as in NumPy."""
    index = SIZES.index((rows, columns)) + VECTORS.index(dtype)
    check(MatrixSpec(rows, columns, "int8", LAYOUTS[index % 4], index % 3 == 2, dtype, result=wp.int32), device)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("transpose", [False, True])
@pytest.mark.parametrize("dtype", VECTORS[:2])
def test_layouts(dtype, layout, transpose, device):
    check(MatrixSpec(20, 43, "int8", layout, transpose, dtype), device)


def check(spec, device):
    rng = np.random.default_rng(0)
    x = numbers(rng, N, spec.columns)
    matrices = numbers(rng, 3, spec.rows, spec.columns)
    biases = rng.integers(-(2**31), 2**31, (3, spec.rows))
    matrix, size = buffers(matrices.transpose(0, 2, 1) if spec.transpose else matrices, spec.layout, device)
    bias, x_array, kernel = bias_buffer(biases, device, "int32"), vectors(spec, x, rng, device), make_kernel(spec)
    for divergence in range(3):
        which, active = choose(divergence)
        product, sums = (wp.zeros(N, dtype=spec.vec_out, device=device) for _ in range(2))
        wp.launch(kernel, N, [x_array, matrix, size, bias, divergence], [product, sums], device=device)
        expected = np.einsum("inj,ij->in", matrices[which], x) * active[:, None]
        np.testing.assert_array_equal(product.numpy().reshape(expected.shape), expected)
        expected = (expected + biases[which] * active[:, None]).astype(np.int32)
        np.testing.assert_array_equal(sums.numpy().reshape(expected.shape), expected)


@pytest.mark.parametrize("precision", ["e4m3", "e5m2"])
@pytest.mark.parametrize("columns", [1, 7, 16, 33])
def test_packed_vectors_are_those_of_floats(precision, columns, device):
    """Every finite code; past the end lie codes that are no numbers."""
    rng, results = np.random.default_rng(0), []
    codes = rng.permutation(256 * 80).astype(np.uint8)[: N * columns].reshape(N, columns)
    values = codes.view(reference.FORMATS[precision]).astype(np.float32)
    codes[~np.isfinite(values)], values[~np.isfinite(values)] = 0, 0.0
    format = MatrixSpec(1, 1, precision).format
    matrix = matrix_buffer(rng.normal(size=(3, 16, columns)), "inferencing_optimal", format, device)
    bias = bias_buffer(np.zeros((3, 16)), device)
    for dtype, x in ((wp.float32, values), (wp.uint32, codes)):
        spec = MatrixSpec(16, columns, precision, dtype=dtype)
        if dtype is wp.uint32:
            x = np.pad(codes, ((0, 0), (0, -columns % 4)), constant_values=0xFF).view(np.uint32)
        y = [wp.zeros(N, dtype=spec.vec_out, device=device) for _ in range(2)]
        x = wp.array(x, dtype=spec.vec_in, device=device)
        wp.launch(make_kernel(spec), N, [x, matrix, 0, bias, 2], y, device=device)
        results.append(y[0].numpy())
    np.testing.assert_array_equal(*results)
    assert results[0].any()
