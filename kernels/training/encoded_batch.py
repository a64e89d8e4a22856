"""Trainable encodings beside the fused kernel: they wait for memory, and so need more threads than its blocks have.

The encoded samples of a batch pass through memory, and their gradients come back in the same place. Each kernel does
one leaf of the encoding; `encoded[i, s]` is part s of its results for sample i.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.kept import kept_by
from warp_neural.kernels.nn.encodings.base import Leaf
from warp_neural.kernels.nn.encodings.parts import make_adjoint_part, make_encode_part, make_shared_sums, vec_part
from warp_neural.kernels.nn.spec import FLOAT16, Format, Parameters
from warp_neural.kernels.training.progress import Progress, batch_of
from warp_neural.kernels.training.taped import data_type, make_all_finite, make_convert, make_draw

TILE = 256  # threads of a block, all with one part
SHARED_SUMS_TILE = 1024


def encoded_type(format: Format) -> type:
    return wp.float16 if format is FLOAT16 else wp.float32


def threads_of(leaf: Leaf, batch: int) -> int:
    """dim of `make_encoded_kernel` for `batch` samples at most."""
    return -(-batch * leaf.encoding.lanes // TILE) * TILE * leaf.encoding.n_parts


@kept_by("sample")
def make_encoded_kernel(sample: wp.Function, use: wp.Function, leaf: Leaf, format: Format) -> wp.Kernel:
    """`use(params, x, encoded[i], part, lane, first)` of every sample i, by whole warps. False flags the step.

    dim `threads_of`, block_dim `TILE`. first: whether this thread is the part's first one. encoded [largest batch,
    parts, results of each]; other arguments as of the fused kernel.
    """
    draw, data, dtype = make_draw(sample), data_type(sample), encoded_type(format)
    lanes = leaf.encoding.lanes

    @wp.kernel(module="unique", enable_backward=False)
    def encoded_kernel(params: Parameters, data: data, progress: Progress, micro: int, encoded: wp.array3d[dtype]):
        thread = wp.tid()
        threads = (encoded.shape[0] * wp.static(lanes) + wp.static(TILE - 1)) / wp.static(TILE) * wp.static(TILE)
        part = thread / threads
        rest = thread - part * threads
        i = rest / wp.static(lanes)
        step = progress.counters[0]
        batch = batch_of(progress, step)
        if rest / 32 * 32 / wp.static(lanes) < batch:
            at = wp.min(i, batch - 1)
            x, _target = draw(progress, step, micro * batch + at, data)
            if not use(params, x, encoded[at], part, rest % wp.static(lanes), i < batch):
                progress.flags[step % 2] = 1

    return encoded_kernel


@cache
def make_encode_sample(leaf: Leaf, vec_in: type, start: int, format: Format) -> wp.Function:
    """For `make_encoded_kernel`: the part of the encoded x, to `encoded`. start: of the parameters in
    `params.master`."""
    dtype, vec_out = encoded_type(format), vec_part(leaf)
    n, encode = vec_out._length_, make_encode_part(leaf, vec_in, start)
    convert, store = make_convert(n, wp.float32, dtype), make_store(n, dtype)

    @wp.func
    def encode_sample(params: Parameters, x: vec_in, encoded: wp.array2d[dtype], part: int, lane: int, inside: bool):
        y = encode(params, x, part, lane)
        if inside and lane == 0:
            store(encoded, part, convert(y))
        return True

    return encode_sample


@cache
def make_adjoint_sample(leaf: Leaf, vec_in: type, start: int, format: Format) -> wp.Function:
    """For `make_encoded_kernel`: `encoded` is the gradient to the part; adds to that of the parameters, but
    for shared sums. False where it is not finite: float16 overflows here while that of the weights is still finite."""
    dtype, n = encoded_type(format), vec_part(leaf)._length_
    convert, load, all_finite = make_convert(n, dtype, wp.float32), make_load(n, dtype), make_all_finite(n)
    adjoint = make_adjoint_part(leaf, vec_in, start)

    @wp.func
    def adjoint_sample(params: Parameters, x: vec_in, encoded: wp.array2d[dtype], part: int, lane: int, inside: bool):
        finite = bool(True)
        if inside:
            dy = convert(load(encoded, part))
            finite = all_finite(dy)
            adjoint(params, x, dy, part, lane)
        return finite

    return adjoint_sample


@kept_by("sample")
def make_shared_sums_kernel(sample: wp.Function, leaf: Leaf, vec_in: type, start: int, format: Format) -> wp.Kernel:
    """The gradients that each block sums by itself first. dim blocks * `SHARED_SUMS_TILE`, which is block_dim."""
    draw, data, dtype = make_draw(sample), data_type(sample), encoded_type(format)
    n, floats = leaf.encoding.n_out(len(leaf.inputs)), leaf.encoding.shared_sums(len(leaf.inputs))
    convert, load = make_convert(n, dtype, wp.float32), make_load(n, dtype)
    clear, add, flush = make_shared_sums(leaf, vec_in, start)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=SHARED_SUMS_TILE)
    def shared_sums_kernel(
        params: Parameters, data: data, progress: Progress, micro: int, blocks: int, encoded: wp.array3d[dtype]
    ):
        thread = wp.tid()
        memory = wp.tile_empty(shape=floats, dtype=wp.float32, storage="shared")
        step = progress.counters[0]
        batch = batch_of(progress, step)
        clear(memory)
        for i in range(thread, batch, blocks * wp.static(SHARED_SUMS_TILE)):
            x, _target = draw(progress, step, micro * batch + i, data)
            add(params, memory, x, convert(load(encoded[i], 0)))  # the parts lie one after the other
        flush(params, memory)

    return shared_sums_kernel
