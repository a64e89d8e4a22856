"""Trainable encodings beside the fused kernel: they wait for memory, and so need more threads than its blocks have.

The encoded samples of a batch pass through memory, and their gradients come back in the same rows.
"""

from functools import cache

import warp as wp

from kernels.coopvec.memory import make_load, make_store
from kernels.coopvec.spec import FLOAT16, Format, Parameters
from kernels.training.general import data_type, make_draw
from kernels.training.progress import Progress, batch_of


def row_type(format: Format) -> type:
    return wp.float16 if format is FLOAT16 else wp.float32


@cache
def make_convert(n: int, source: type, target: type) -> wp.Function:
    """Between vectors of n float16 and float32."""
    vec_in, vec_out = wp.types.vector(n, source), wp.types.vector(n, target)

    @wp.func_native(
        f"wp::vec_t<{n}, wp::{target.__name__}> y;\n"
        f"for (int i = 0; i < {n}; ++i) y.c[i] = static_cast<wp::{target.__name__}>(x.c[i]);\nreturn y;\n"
    )
    def convert(x: vec_in) -> vec_out: ...

    return convert


@cache
def make_encode_rows_kernel(sample: wp.Function, encode: wp.Function, n: int, format: Format) -> wp.Kernel:
    """dim (largest batch): row i is the encoded sample i. Arguments as of the fused kernel."""
    draw, data, rows_of = make_draw(sample), data_type(sample), row_type(format)
    convert, store = make_convert(n, wp.float32, rows_of), make_store(n, rows_of)

    @wp.kernel(module="unique", enable_backward=False)
    def encode_rows_kernel(params: Parameters, data: data, progress: Progress, micro: int, rows: wp.array2d[rows_of]):
        i = wp.tid()
        step = progress.counters[0]
        batch = batch_of(progress, step)
        if i < batch:
            x, _target = draw(progress, step, micro * batch + i, data)
            store(rows, i, convert(encode(params, x)))

    return encode_rows_kernel


@cache
def make_adjoint_rows_kernel(sample: wp.Function, adjoint: wp.Function, n: int, format: Format) -> wp.Kernel:
    """dim (largest batch): row i is the gradient to the encoded sample i; adds to `params.master.grad`."""
    draw, data, rows_of = make_draw(sample), data_type(sample), row_type(format)
    convert, load = make_convert(n, rows_of, wp.float32), make_load(n, rows_of)

    @wp.kernel(module="unique", enable_backward=False)
    def adjoint_rows_kernel(params: Parameters, data: data, progress: Progress, micro: int, rows: wp.array2d[rows_of]):
        i = wp.tid()
        step = progress.counters[0]
        batch = batch_of(progress, step)
        if i < batch:
            x, _target = draw(progress, step, micro * batch + i, data)
            adjoint(params, x, convert(load(rows, i)))

    return adjoint_rows_kernel
