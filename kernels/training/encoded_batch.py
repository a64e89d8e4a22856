"""Trainable encodings beside the fused kernel: they wait for memory, and so need more threads than its blocks have.

The encoded samples of a batch pass through memory, and their gradients come back in the same rows. Each kernel does one
leaf of the encoding; `rows[i, s]` is share s of its results for sample i.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.nn.encodings.base import Leaf
from warp_neural.kernels.nn.encodings.shares import make_adjoint_share, make_crowd, make_encode_share, vec_share
from warp_neural.kernels.nn.spec import FLOAT16, Format, Parameters
from warp_neural.kernels.training.progress import Progress, batch_of
from warp_neural.kernels.training.taped import data_type, make_convert, make_draw

TILE = 256  # threads of a block, all with one share
CROWD_TILE = 1024


def row_type(format: Format) -> type:
    return wp.float16 if format is FLOAT16 else wp.float32


def threads_of(leaf: Leaf, batch: int) -> int:
    """dim of `make_rows_kernel` for `batch` samples at most."""
    return -(-batch * leaf.encoding.lanes // TILE) * TILE * leaf.encoding.shares


@cache
def make_rows_kernel(sample: wp.Function, use: wp.Function, leaf: Leaf, format: Format) -> wp.Kernel:
    """`use(params, x, rows[i], share, lane, first)` of every sample i, by whole warps.

    dim `threads_of`, block_dim `TILE`. first: whether this thread is the share's first one. rows [largest batch,
    shares, results of each]; other arguments as of the fused kernel.
    """
    draw, data, rows_of = make_draw(sample), data_type(sample), row_type(format)
    lanes = leaf.encoding.lanes

    @wp.kernel(module="unique", enable_backward=False)
    def rows_kernel(params: Parameters, data: data, progress: Progress, micro: int, rows: wp.array3d[rows_of]):
        thread = wp.tid()
        threads = (rows.shape[0] * wp.static(lanes) + wp.static(TILE - 1)) / wp.static(TILE) * wp.static(TILE)
        share = thread / threads
        rest = thread - share * threads
        i = rest / wp.static(lanes)
        step = progress.counters[0]
        batch = batch_of(progress, step)
        if rest / 32 * 32 / wp.static(lanes) < batch:
            at = wp.min(i, batch - 1)
            x, _target = draw(progress, step, micro * batch + at, data)
            use(params, x, rows[at], share, rest % wp.static(lanes), i < batch)

    return rows_kernel


@cache
def make_encode_row(leaf: Leaf, vec_in: type, start: int, format: Format) -> wp.Function:
    """For `make_rows_kernel`: the share of the encoded x, to its row. start: of the parameters in `params.master`."""
    rows_of, vec_out = row_type(format), vec_share(leaf)
    n, encode = vec_out._length_, make_encode_share(leaf, vec_in, start)
    convert, store = make_convert(n, wp.float32, rows_of), make_store(n, rows_of)

    @wp.func
    def encode_row(params: Parameters, x: vec_in, rows: wp.array2d[rows_of], share: int, lane: int, inside: bool):
        y = encode(params, x, share, lane)
        if inside and lane == 0:
            store(rows, share, convert(y))

    return encode_row


@cache
def make_adjoint_row(leaf: Leaf, vec_in: type, start: int, format: Format) -> wp.Function:
    """For `make_rows_kernel`: the row is the gradient to the share; adds to that of all parameters not crowded."""
    rows_of, n = row_type(format), vec_share(leaf)._length_
    convert, load = make_convert(n, rows_of, wp.float32), make_load(n, rows_of)
    adjoint = make_adjoint_share(leaf, vec_in, start)

    @wp.func
    def adjoint_row(params: Parameters, x: vec_in, rows: wp.array2d[rows_of], share: int, lane: int, inside: bool):
        if inside:
            adjoint(params, x, convert(load(rows, share)), share, lane)

    return adjoint_row


@cache
def make_crowd_kernel(sample: wp.Function, leaf: Leaf, vec_in: type, start: int, format: Format) -> wp.Kernel:
    """The gradients of what is crowded, after sums in each block. dim blocks * `CROWD_TILE`, block_dim `CROWD_TILE`."""
    draw, data, rows_of = make_draw(sample), data_type(sample), row_type(format)
    n, floats = leaf.encoding.n_out(len(leaf.inputs)), leaf.encoding.crowded(len(leaf.inputs))
    convert, load = make_convert(n, rows_of, wp.float32), make_load(n, rows_of)
    clear, add, flush = make_crowd(leaf, vec_in, start)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=CROWD_TILE)
    def crowd_kernel(
        params: Parameters, data: data, progress: Progress, micro: int, blocks: int, rows: wp.array3d[rows_of]
    ):
        thread = wp.tid()
        memory = wp.tile_empty(shape=floats, dtype=wp.float32, storage="shared")
        step = progress.counters[0]
        batch = batch_of(progress, step)
        clear(memory)
        for i in range(thread, batch, blocks * wp.static(CROWD_TILE)):
            x, _target = draw(progress, step, micro * batch + i, data)
            add(params, memory, x, convert(load(rows[i], 0)))  # the shares lie one after the other
        flush(params, memory)

    return crowd_kernel
