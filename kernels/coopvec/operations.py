"""The four operations of GL_NV_cooperative_vector as functions of the calling thread, one matrix product at a time.

A matrix lies in a `Buffer` of 32-bit words at a byte offset, in one of the four layouts, as do biases. Gradients lie in
the buffer's float32 `gradient`, one float for each element, in the same layout and order: element i of the data has
gradient[i]. `network.make_network` fuses whole networks and is faster; these serve where layers need something between.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from warp_neural.kernels.coopvec import operations_text as text
from warp_neural.kernels.coopvec.convert import LAYOUTS
from warp_neural.kernels.coopvec.pool import pool
from warp_neural.kernels.coopvec.product_types import PACKED, check_product
from warp_neural.kernels.errors import InputError, require, require_whole
from warp_neural.kernels.nn.spec import C_TYPES, INT8, MAX_SIZE, Format, check_vector, format_of


@wp.struct
class Buffer:
    """Matrices or vectors of one format, and their gradients (an empty array: none is wanted)."""

    data: wp.array[wp.uint32]
    gradient: wp.array[float]


@dataclass(frozen=True)
class MatrixSpec:
    """One product: `rows` x `columns` is the matrix as it multiplies, after `transpose`.

    precision: the format of the matrix and of the vector inside the product. layout: "row_major", "column_major",
    "inferencing_optimal" or "training_optimal" (of the stored matrix; the last for gradients). dtype: of the vectors'
    elements, floats that are rounded to the format, `wp.int8`, or `wp.uint32` with four 8-bit values in each, the first
    in the low byte; what lies past the last value does not matter. accumulation: "float32" (int8: stands for int32) or
    "float16". bias: "float32", "float16" or "int32". result: of the results' elements, `wp.int32` for exact sums of
    int8. Without them the results are floats as the vectors are (int32, of vectors of int8; float32, of packed e4m3 and
    e5m2), the bias is int32 for int32 and otherwise float32. `coopvec.combination_table` shows what goes together.
    """

    rows: int
    columns: int
    precision: str = "float16"
    layout: str = "inferencing_optimal"
    transpose: bool = False
    dtype: type = wp.float32
    accumulation: str = "float32"
    bias: str | None = None
    result: type | None = None

    def __post_init__(self):
        for name in ("rows", "columns"):
            require_whole(name, getattr(self, name), 1, MAX_SIZE)
        types = check_product(self.format, self.accumulation, self.dtype, self.result, self.bias)
        for name, value in zip(("result", "bias"), types, strict=True):
            object.__setattr__(self, name, value)
        require(self.layout in LAYOUTS, "layout", self.layout, f"one of {', '.join(LAYOUTS)}")

    @property
    def format(self) -> Format:
        return format_of(self.precision)

    @property
    def vec_in(self) -> type:
        n = -(-self.columns // self.format.per_word) if self.dtype is PACKED else self.columns
        return wp.types.vector(n, self.dtype)

    @property
    def vec_out(self) -> type:
        return wp.types.vector(self.rows, self.result)


@cache
def make_matmul_add(spec: MatrixSpec) -> wp.Function:
    """`(v, matrix, matrix_offset, matrix_stride, bias, bias_offset) -> W v + b` (coopVecMatMulAddNV).

    v: `spec.vec_in`; matrix, bias: `Buffer`; offsets and the stride between rows (columns) in bytes, stride 0: tight.
    Differentiable in v, and in matrix and bias where they have a gradient array; results of int32 have no gradients.
    int8: floats in v are rounded to the nearest of -128 to 127, ties to even, the products are summed exactly.
    """
    vec_in, vec_out, differentiable = spec.vec_in, spec.vec_out, spec.result is not wp.int32

    @wp.func_native(text.product_text(spec, with_bias=True))
    def product(
        v: vec_in,
        matrix: Buffer,
        matrix_offset: int,
        matrix_stride: int,
        bias: Buffer,
        bias_offset: int,
        pool: wp.uint32,
    ) -> vec_out: ...

    @wp.func_native(text.product_adjoint_text(spec, with_bias=True))
    def product_adjoint(
        v: vec_in, matrix: Buffer, matrix_offset: int, matrix_stride: int, bias: Buffer, bias_offset: int, dy: vec_out
    ) -> vec_in: ...

    @wp.func
    def matmul_add(
        v: vec_in, matrix: Buffer, matrix_offset: int, matrix_stride: int, bias: Buffer, bias_offset: int
    ) -> vec_out:
        return product(v, matrix, matrix_offset, matrix_stride, bias, bias_offset, pool())

    @wp.func_grad(matmul_add)
    def adj_matmul_add(
        v: vec_in,
        matrix: Buffer,
        matrix_offset: int,
        matrix_stride: int,
        bias: Buffer,
        bias_offset: int,
        adj_ret: vec_out,
    ):
        if wp.static(differentiable):
            wp.adjoint[v] += product_adjoint(v, matrix, matrix_offset, matrix_stride, bias, bias_offset, adj_ret)

    return matmul_add


@cache
def make_matmul(spec: MatrixSpec) -> wp.Function:
    """`(v, matrix, matrix_offset, matrix_stride) -> W v` (coopVecMatMulNV); see `make_matmul_add`."""
    vec_in, vec_out, differentiable = spec.vec_in, spec.vec_out, spec.result is not wp.int32

    @wp.func_native(text.product_text(spec, with_bias=False))
    def product(v: vec_in, matrix: Buffer, matrix_offset: int, matrix_stride: int, pool: wp.uint32) -> vec_out: ...

    @wp.func_native(text.product_adjoint_text(spec, with_bias=False))
    def product_adjoint(v: vec_in, matrix: Buffer, matrix_offset: int, matrix_stride: int, dy: vec_out) -> vec_in: ...

    @wp.func
    def matmul(v: vec_in, matrix: Buffer, matrix_offset: int, matrix_stride: int) -> vec_out:
        return product(v, matrix, matrix_offset, matrix_stride, pool())

    @wp.func_grad(matmul)
    def adj_matmul(v: vec_in, matrix: Buffer, matrix_offset: int, matrix_stride: int, adj_ret: vec_out):
        if wp.static(differentiable):
            wp.adjoint[v] += product_adjoint(v, matrix, matrix_offset, matrix_stride, adj_ret)

    return matmul


def check_gradient(dtype: type) -> None:
    require(dtype in C_TYPES, "gradient_dtype", dtype, "wp.float32 or wp.float16, the gradient's element type")


@cache
def make_outer_product_accumulate(spec: MatrixSpec, gradient_dtype: type = wp.float32) -> wp.Function:
    """`(a, b, gradient, offset, stride)`: gradient += a bᵀ, atomically (coopVecOuterProductAccumulateNV).

    a: `spec.vec_out`; b: `spec.vec_in`; gradient: array of `gradient_dtype` holding a rows x columns matrix in
    `spec.layout` from element `offset` on, rows (columns) `stride` elements apart (0: tight). float16 and bfloat16
    multiply on tensor cores where a whole warp arrives, which sums its 32 threads before one addition to memory.

    In float16 each addition to memory rounds to nearest even: what is added, a warp's float32 sum or the product of a
    thread that arrives without one, and then the sum. So 2048 does not grow by ones, and sums past 65504 are infinite.
    CUDA adds in any order, the CPU in that of its threads.
    """
    if spec.format is INT8:
        raise InputError("outer_product_accumulate needs a floating-point precision, not int8")
    require(spec.dtype is spec.result, "dtype", spec.dtype, "wp.float32 or wp.float16, one type of both vectors")
    check_gradient(gradient_dtype)
    vec_a, vec_b, target = spec.vec_out, spec.vec_in, wp.array(dtype=gradient_dtype)

    @wp.func_native(text.outer_product_text(spec, gradient_dtype))
    def outer_product(a: vec_a, b: vec_b, gradient: target, offset: int, stride: int, pool: wp.uint32): ...

    @wp.func
    def outer_product_accumulate(a: vec_a, b: vec_b, gradient: target, offset: int, stride: int):
        outer_product(a, b, gradient, offset, stride, pool())

    @wp.func_grad(outer_product_accumulate)
    def adj_outer_product_accumulate(a: vec_a, b: vec_b, gradient: target, offset: int, stride: int):
        pass  # it is part of a gradient itself

    return outer_product_accumulate


@cache
def make_reduce_sum_accumulate(n: int, dtype: type, gradient_dtype: type = wp.float32) -> wp.Function:
    """`(v, gradient, offset)`: gradient[offset + i] += v[i], atomically (coopVecReduceSumAccumulateNV).

    gradient: array of `gradient_dtype`; float16 rounds as in `make_outer_product_accumulate`.
    """
    check_vector(n, dtype)
    check_gradient(gradient_dtype)
    vec, target = wp.types.vector(n, dtype), wp.array(dtype=gradient_dtype)

    @wp.func_native(text.reduce_sum_text(n, gradient_dtype))
    def reduce_sum_accumulate(v: vec, gradient: target, offset: int): ...

    return reduce_sum_accumulate
