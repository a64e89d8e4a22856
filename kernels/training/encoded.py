"""Trainable encodings beside the fused kernel: they wait for memory, and so need more threads than its blocks have.

The encoded samples of a batch pass through memory, and their gradients come back in the same rows.
"""

from functools import cache

import warp as wp

from kernels.coopvec.memory import make_load, make_store
from kernels.coopvec.spec import FLOAT16, Format, Parameters
from kernels.training.general import data_type, make_convert, make_draw
from kernels.training.progress import Progress, batch_of


def row_type(format: Format) -> type:
    return wp.float16 if format is FLOAT16 else wp.float32


@cache
def make_rows_kernel(sample: wp.Function, use: wp.Function, format: Format) -> wp.Kernel:
    """dim (largest batch): `use(params, x, rows, i)` of every sample i. Arguments as of the fused kernel."""
    draw, data, rows_of = make_draw(sample), data_type(sample), row_type(format)

    @wp.kernel(module="unique", enable_backward=False)
    def rows_kernel(params: Parameters, data: data, progress: Progress, micro: int, rows: wp.array2d[rows_of]):
        i = wp.tid()
        step = progress.counters[0]
        batch = batch_of(progress, step)
        if i < batch:
            x, _target = draw(progress, step, micro * batch + i, data)
            use(params, x, rows, i)

    return rows_kernel


@cache
def make_encode_row(encode: wp.Function, n: int, format: Format) -> wp.Function:
    """For `make_rows_kernel`: row i becomes the encoded x."""
    rows_of = row_type(format)
    convert, store, vec_in = make_convert(n, wp.float32, rows_of), make_store(n, rows_of), encode.input_types["x"]

    @wp.func
    def encode_row(params: Parameters, x: vec_in, rows: wp.array2d[rows_of], i: int):
        store(rows, i, convert(encode(params, x)))

    return encode_row


@cache
def make_adjoint_row(adjoint: wp.Function, n: int, format: Format) -> wp.Function:
    """For `make_rows_kernel`: row i is the gradient to the encoded x; adds to `params.master.grad`."""
    rows_of = row_type(format)
    convert, load, vec_in = make_convert(n, rows_of, wp.float32), make_load(n, rows_of), adjoint.input_types["x"]

    @wp.func
    def adjoint_row(params: Parameters, x: vec_in, rows: wp.array2d[rows_of], i: int):
        adjoint(params, x, convert(load(rows, i)))

    return adjoint_row
