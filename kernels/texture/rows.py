"""Whole pictures of a neural texture on the CPU: rows, a chunk of texels at a time, channels in vectors of 16.

Tables [grid][phase y][phase x][4 taps][channels, padded to vectors]: float32 weights of the latents. Scratch memory of
each call and the network's pass are those of `kernels.training.cpu.forward`.
"""

from functools import cache
from pathlib import Path
from typing import Any

import warp as wp

from warp_neural.kernels.coopvec.cpu.network import LANES
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters, round_up
from warp_neural.kernels.texture.spec import TAPS, TextureSpec
from warp_neural.kernels.texture.taps import make_taps
from warp_neural.kernels.training.cpu.forward import CHUNK, chunk_forward_text, enter

NATIVE = Path(__file__).parent / "native"


def row_tables(spec: TextureSpec) -> list[int]:
    """Where each grid's begins, and the end of all, in floats."""
    ends = [0]
    for grid in spec.grids:
        ends.append(ends[-1] + grid.scale**2 * TAPS * round_up(grid.channels, LANES))
    return ends


@cache
def make_row_table_kernel(spec: TextureSpec, g: int) -> wp.Kernel:
    """The trained kernel of a grid to its table. dim [scale, scale, channels]."""
    taps, scale, start = make_taps(spec, g), spec.grids[g].scale, row_tables(spec)[g]
    width = round_up(spec.grids[g].channels, LANES)

    @wp.kernel(module="unique", enable_backward=False)
    def table_kernel(kernels: wp.array[float], tables: wp.array[float]):
        y, x, c = wp.tid()
        weights = taps(kernels, c, y, x)
        for tap in range(4):
            tables[start + ((y * scale + x) * 4 + tap) * width + c] = weights[tap]

    return table_kernel


@cache
def make_rows_kernel(spec: TextureSpec, network: NetworkSpec, params_type: Any) -> wp.Kernel:
    """Rows `begin` to `end` - 1 of `values` [height, width, channels], whose first texel is (top, left) of a level.
    dim 1. scratch: of this launch alone."""

    @wp.func_native(features_text(spec, network))
    def features(
        params: params_type,
        tables: wp.array[float],
        mip: int,
        i: int,
        j0: int,
        count: int,
        scratch: wp.array[float],
    ): ...

    @wp.func_native(chunk_forward_text(network))
    def forward(params: Parameters, scratch: wp.array[float], count: int): ...

    @wp.func_native(store_text(spec, network))
    def store(scratch: wp.array[float], count: int, values: wp.array3d[float], row: int, column: int): ...

    @wp.kernel(module="unique", enable_backward=False)
    def rows_kernel(
        params: params_type,
        parameters: Parameters,
        tables: wp.array[float],
        mip: int,
        top: int,
        left: int,
        begin: int,
        end: int,
        scratch: wp.array[float],
        values: wp.array3d[float],
    ):
        row = begin
        while row < end:
            column = int(0)
            while column < values.shape[1]:
                count = wp.min(values.shape[1] - column, CHUNK)
                features(params, tables, mip, top + row, left + column, count, scratch)
                forward(parameters, scratch, count)
                store(scratch, count, values, row, column)
                column += CHUNK
            row += 1

    return rows_kernel


def features_text(spec: TextureSpec, network: NetworkSpec) -> str:
    """The body of `features`: the inputs of the first `count` samples."""
    k, first = round_up(spec.n_in, LANES), 0
    text = enter(network) + paste(NATIVE / "row_features.h", GRIDS=len(spec.grids), K=k)
    for g, (grid, table) in enumerate(zip(spec.grids, row_tables(spec), strict=False)):
        numbers = {"INDEX": g, "SCALE": grid.scale, "CHANNELS": grid.channels, "BITS": grid.resident_bits}
        numbers |= {"LIMIT": grid.limit, "TABLE": table, "FIRST": first}
        fields = ", ".join(f"{name} = {value}" for name, value in numbers.items())
        text += f"struct Grid{g} {{ enum {{ {fields} }}; }};\nadd_grid(Grid{g}());\n"
        first += grid.channels
    if spec.mips > 1:
        text += f"for (int n = 0; n < count; ++n) h0[n * {k} + {first}] = params.levels.detail.data[mip];\n"
    return text


def store_text(spec: TextureSpec, network: NetworkSpec) -> str:
    """The body of `store`: results to a row of contiguous `values`."""
    h, n, width = f"h{len(network.layers)}", spec.channels, round_up(spec.channels, LANES)
    return f"""{enter(network)}real* const y = values.data + (wp::int64(row) * values.shape[1] + column) * {n};
for (int i = 0; i < count; ++i) for (int c = 0; c < {n}; ++c) y[i * {n} + c] = {h}[i * {width} + c];
"""
