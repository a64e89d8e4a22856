"""Encodings for CUDA kernels of many samples: a thread has one part of the results, or one of the lanes of a part.

`leaf` is what is encoded; its parameters start `start` floats into `params.master`.
"""

from functools import cache
from math import gcd
from pathlib import Path
from typing import NamedTuple

import warp as wp

from warp_neural.kernels.native import ATOMICS, paste
from warp_neural.kernels.nn.encodings.base import UNROLL, WHOLE, Leaf, enter
from warp_neural.kernels.nn.spec import Parameters

NATIVE = Path(__file__).parent / "native"

SUM_LANES = f"""#if defined(__CUDA_ARCH__)
{UNROLL}for (int m = 1; m < lanes; m *= 2) for (real& value : y.c) value += __shfl_xor_sync(0xffffffffu, value, m);
#endif
"""


def each_part(leaf: Leaf, text: str) -> str:
    """`text` of part `which`, a constant in it."""
    parts, lanes = leaf.encoding.n_parts, leaf.encoding.lanes
    begin = f"constexpr int parts = {parts}, lanes = {lanes};\nconst int lane = of & {lanes - 1};\n"
    return begin + "".join(f"if (which == {s}) {{\nconstexpr int part = {s};\n{text}}}\n" for s in range(parts))


def vec_part(leaf: Leaf) -> type:
    return wp.types.vector(leaf.encoding.n_out(len(leaf.inputs)) // leaf.encoding.n_parts, wp.float32)


@cache
def make_encode_part(leaf: Leaf, vec_in: type, start: int) -> wp.Function:
    """`(params, x, which, of) -> the part's results`, by its lanes together: whole warps. of: which lane."""
    vec_out, n_in = vec_part(leaf), len(leaf.inputs)
    text = "real* const out = y.c;\n" + leaf.encoding.encode_text(n_in, gcd(start, 4)) + SUM_LANES
    begin = enter(leaf.inputs, start, 0) + f"wp::vec_t<{vec_out._length_}, real> y;\n"

    @wp.func_native(begin + each_part(leaf, text) + "return y;\n")
    def encode(params: Parameters, x: vec_in, which: int, of: int) -> vec_out: ...

    return encode


def leaf_adjoint_text(leaf: Leaf, start: int) -> str:
    n_in = len(leaf.inputs)
    begin = f"real d_in[{n_in}] = {{}};\nconst real* const d_out = dy.c;\n"
    return begin + leaf.encoding.adjoint_text(n_in, gcd(start, 4))


@cache
def make_adjoint_part(leaf: Leaf, vec_in: type, start: int) -> wp.Function:
    """`(params, x, dy, which, of)`: adds to `params.master.grad`, but for shared sums; of: which lane."""
    vec_out = vec_part(leaf)
    begin = enter(leaf.inputs, start, 0) + "real* const grad = params.master.grad + start;\n" + ATOMICS
    begin += "constexpr bool shared_sums = false, direct_sums = true;\n"

    @wp.func_native(begin + each_part(leaf, leaf_adjoint_text(leaf, start)))
    def adjoint(params: Parameters, x: vec_in, dy: vec_out, which: int, of: int): ...

    return adjoint


class SharedSums(NamedTuple):
    """Native functions for `Encoding.shared_sums` of a block; `memory` is a tile of as many floats."""

    clear: wp.Function  # (memory), whole blocks
    add: wp.Function  # (params, memory, x, dy) of a sample, all its parts
    flush: wp.Function  # (params, memory), whole blocks: adds the sums to `params.master.grad`


@cache
def make_shared_sums(leaf: Leaf, vec_in: type, start: int) -> SharedSums:
    n_in = len(leaf.inputs)
    n, vec_out = leaf.encoding.shared_sums(n_in), wp.types.vector(leaf.encoding.n_out(n_in), wp.float32)
    memory_of = wp.tile(dtype=wp.float32, shape=(n,))
    sizes = {"N": n, "WIDTH": gcd(n, start, 4)}
    add_text = WHOLE.replace("direct_sums = true", "direct_sums = false") + enter(leaf.inputs, start, 0)
    add_text += (
        f"real* const grad = memory.data.ptr;\n{paste(NATIVE / 'add_shared.cuh')}{leaf_adjoint_text(leaf, start)}"
    )
    flush_text = f"using real = wp::float32;\nreal* const grad = params.master.grad + {start};\n{ATOMICS}"

    @wp.func_native(paste(NATIVE / "clear_sums.cuh", **sizes))
    def clear(memory: memory_of): ...

    @wp.func_native(add_text)
    def add(params: Parameters, memory: memory_of, x: vec_in, dy: vec_out): ...

    @wp.func_native(flush_text + paste(NATIVE / "flush_sums.cuh", **sizes))
    def flush(params: Parameters, memory: memory_of): ...

    return SharedSums(clear, add, flush)
