"""Whole pictures of a neural texture on tensor cores: a warp decodes 8 x 4 texels, all in registers.

The features of a 2 x 2 block of texels, which is in one cell of every grid, are sums of float16 in the lanes that hold
them as the operand of `mma.sync`; products sum in float32, activations are of float16. Channels of each grid are padded
to slabs of 8 columns of the first layer, two slabs a product.

Tables [slab][texel of a block][phase of blocks][4 pairs of channels][4 taps][2]: float16 weights of the latents.
Vectors between layers are log2 e times what they are, for powers of 2 as they stand: weights of the first layer take
that in, those of the last take it out.

Weights [layer][16 inputs][16 outputs][lane][8]: float16, second operands of two products. Biases [mip][layer][pairs
of outputs][2][2]: float32, each pair twice, as sums have rows g and g + 8; of the first layer with the level of detail.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import warp as wp

from warp_neural.kernels.coopvec import NATIVE as COOPVEC
from warp_neural.kernels.coopvec.cuda.primitives import mma
from warp_neural.kernels.native import paste, unroll
from warp_neural.kernels.nn.spec import FLOAT16, round_up
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.kernels.texture.taps import make_taps

NATIVE = Path(__file__).parent / "native"
TILE_WIDTH, TILE_HEIGHT = 8, 4  # texels of a warp
BLOCK = 128


@dataclass(frozen=True)
class TensorLayout:
    """Of what the kernel reads, in units of 16 bytes, of weights 32 lanes of these."""

    spec: TextureSpec

    @property
    def fits(self) -> bool:
        """Whether the kernel is for such textures: at most 64 neurons a layer, and no cell smaller than a block."""
        return self.spec.grids[0].scale >= 2 and max(self.spec.hidden) <= 64

    @cached_property
    def slabs(self) -> tuple[int, ...]:
        """Of each grid."""
        return tuple(-(-grid.channels // 8) for grid in self.spec.grids)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Inputs and outputs of all layers, padded."""
        return tuple(round_up(n, 16) for n in (8 * sum(self.slabs), *self.spec.hidden, self.spec.channels))

    @cached_property
    def tables(self) -> tuple[int, ...]:
        """Where each grid's begins, and the end of all."""
        ends = [0]
        for grid, slabs in zip(self.spec.grids, self.slabs, strict=True):
            ends.append(ends[-1] + slabs * 4 * grid.scale**2)
        return tuple(ends)

    @cached_property
    def weights(self) -> tuple[int, ...]:
        """Where each layer's begin, and the end of all."""
        ends = [0]
        for n_in, n_out in zip(self.sizes[:-1], self.sizes[1:], strict=True):
            ends.append(ends[-1] + n_in // 16 * (n_out // 16))
        return tuple(ends)

    @cached_property
    def biases(self) -> tuple[int, ...]:
        """Where each layer's begin, and the end of a level's."""
        return tuple(sum(self.sizes[1 : 1 + l]) // 2 for l in range(len(self.sizes)))


@cache
def make_table_kernel(spec: TextureSpec, g: int) -> wp.Kernel:
    """The trained kernel of a grid to its table. dim [scale, scale, channels of whole slabs]."""
    taps, scale, channels = make_taps(spec, g), spec.grids[g].scale, spec.grids[g].channels
    start, phases = 8 * TensorLayout(spec).tables[g], (scale // 2) ** 2

    @wp.kernel(module="unique", enable_backward=False)
    def table_kernel(kernels: wp.array[float], tables: wp.array[wp.float16]):
        y, x, c = wp.tid()
        weights = wp.vec4()
        if c < channels:
            weights = taps(kernels, c, y, x)
        phase = y / 2 * (scale / 2) + x / 2
        at = (c / 8 * 4 + y % 2 * 2 + x % 2) * phases + phase
        for tap in range(4):
            tables[start + (at * 4 + c % 8 / 2) * 8 + tap * 2 + c % 2] = wp.float16(weights[tap])

    return table_kernel


@cache
def make_tensor_decode_kernel(spec: TextureSpec, params_type: Any, dtype: type) -> wp.Kernel:
    """Texels of a rectangle (left, top, width, height) of a level to `values` [height, width, channels], contiguous:
    float, `wp.float16`, or `wp.uint8`, 0 to 255 as 0 to 1. dim: `tensor_dim`. For CUDA from sm_80 on."""

    @wp.func_native(f"#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800\n{tile_text(spec, dtype)}\n#endif\n")
    def decode_tile(
        params: params_type,
        tables: wp.array[wp.uint32],
        weights: wp.array[wp.uint32],
        biases: wp.array[float],
        mip: int,
        rectangle: wp.vec4i,
        top: int,
        left: int,
        values: wp.array3d[dtype],
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def tensor_decode_kernel(
        params: params_type,
        tables: wp.array[wp.uint32],
        weights: wp.array[wp.uint32],
        biases: wp.array[float],
        mip: int,
        rectangle: wp.vec4i,
        values: wp.array3d[dtype],
    ):
        tile = wp.tid() / 32
        first = rectangle[0] / TILE_WIDTH
        columns = (rectangle[0] + rectangle[2] - 1) / TILE_WIDTH - first + 1
        top = (rectangle[1] / TILE_HEIGHT + tile / columns) * TILE_HEIGHT
        left = (first + tile % columns) * TILE_WIDTH
        if top < rectangle[1] + rectangle[3]:
            decode_tile(params, tables, weights, biases, mip, rectangle, top, left, values)

    return tensor_decode_kernel


def tensor_dim(left: int, top: int, width: int, height: int) -> int:
    """Threads that decode a rectangle, whole blocks."""
    columns = (left + width - 1) // TILE_WIDTH - left // TILE_WIDTH + 1
    rows = (top + height - 1) // TILE_HEIGHT - top // TILE_HEIGHT + 1
    return round_up(columns * rows * 32, BLOCK)


def tile_text(spec: TextureSpec, dtype: type) -> str:
    """The body of `decode_tile`."""
    layout = TensorLayout(spec)
    names = paste(COOPVEC / "lanes.cuh") + paste(COOPVEC / "halves.cuh") + mma("multiply", FLOAT16, "real")
    grids = "".join(grid_text(layout, g, grid) for g, grid in enumerate(spec.grids))
    layers = "".join(layer_text(layout, l) for l in range(1, len(spec.hidden)))
    tile = paste(NATIVE / "decode_tile.cuh", GRIDS=len(spec.grids), LEVEL_BIASES=layout.biases[-1])
    return unroll(f"""{names}{tile}{grids}{first_layer_text(layout)}{layers}{last_layer_text(layout, dtype)}""")


def grid_text(layout: TensorLayout, g: int, grid: Grid) -> str:
    """Its numbers as a type, and the cells that the block reads."""
    numbers = {"INDEX": g, "SCALE": grid.scale, "CHANNELS": grid.channels, "BITS": grid.resident_bits}
    numbers |= {"LIMIT": grid.limit, "TABLE": layout.tables[g]}
    fields = ", ".join(f"{name} = {value}" for name, value in numbers.items())
    return f"struct Grid{g} {{ enum {{ {fields} }}; }};\nunsigned cells{g}[4];\nlocate(Grid{g}(), cells{g});\n"


def first_layer_text(layout: TensorLayout) -> str:
    """`a0`, the operand of the next layer; features of 16 columns at a time are made and multiplied."""
    slabs = [(g, s) for g, count in enumerate(layout.slabs) for s in range(count)]
    pairs, start = layout.sizes[1] // 16, start_text(0)
    text = f"""unsigned a0[2][{pairs}][4];
{{ real c[2][{pairs}][2][4];
"""
    for block in range(layout.sizes[0] // 16):
        both = enumerate(slabs[2 * block : 2 * block + 2])
        adds = "".join(f"add_slab(Grid{g}(), {s}, cells{g}, a, {half});\n" for half, (g, s) in both)
        text += f"""{{ unsigned a[2][4] = {{}};
{adds}UNROLL for (int j = 0; j < {pairs}; ++j) {{
    const uint4 w = weights_at({block * pairs} + j);
    {start if block == 0 else ""}UNROLL for (int m = 0; m < 2; ++m) {{
        multiply(c[m][j][0], {"bias[0]" if block == 0 else "c[m][j][0]"}, a[m], w.x, w.y);
        multiply(c[m][j][1], {"bias[1]" if block == 0 else "c[m][j][1]"}, a[m], w.z, w.w);
    }} }} }}
"""
    to_operands = f"UNROLL for (int j = 0; j < {pairs}; ++j) to_operand(c[m][j], a0[m][j]);"
    return f"{text}UNROLL for (int m = 0; m < 2; ++m) {to_operands}\n}}\n"


def start_text(at: int) -> str:
    return f"real bias[2][4]; UNROLL for (int i = 0; i < 2; ++i) bias_at({at}, 2 * j + i, bias[i]);\n"


def products_text(layout: TensorLayout, l: int) -> str:
    """`c`, the sums of layer l and outputs 16 j to 16 j + 15."""
    blocks, pairs = layout.sizes[l] // 16, layout.sizes[l + 1] // 16
    return f"""real c[2][2][4];
{start_text(layout.biases[l])}UNROLL for (int b = 0; b < {blocks}; ++b) {{
    const uint4 w = weights_at({layout.weights[l]} + b * {pairs} + j);
    UNROLL for (int m = 0; m < 2; ++m) {{
        multiply(c[m][0], b == 0 ? bias[0] : c[m][0], a{l - 1}[m][b], w.x, w.y);
        multiply(c[m][1], b == 0 ? bias[1] : c[m][1], a{l - 1}[m][b], w.z, w.w);
    }} }}
"""


def layer_text(layout: TensorLayout, l: int) -> str:
    """Hidden layer l, 16 outputs at a time: from the operand `a{l - 1}` to `a{l}`."""
    pairs = layout.sizes[l + 1] // 16
    return f"""unsigned a{l}[2][{pairs}][4];
UNROLL for (int j = 0; j < {pairs}; ++j) {{
{products_text(layout, l)}UNROLL for (int m = 0; m < 2; ++m) to_operand(c[m], a{l}[m][j]);
}}
"""


def last_layer_text(layout: TensorLayout, dtype: type) -> str:
    return f"""{{ constexpr int j = 0;
{products_text(layout, len(layout.sizes) - 2)}{store_text(layout.spec.channels, dtype)}}}
"""


def store_text(channels: int, dtype: type) -> str:
    """Of the sums `c` those inside the rectangle to `values`: channels 8 i + 2 t and the next, in one piece if the
    number of channels is even."""
    value, pair, word = {
        float: ("wp::float32", "float2", "make_float2(v0, v1)"),
        wp.float16: ("wp::float16", "unsigned", "half_pack(v0, v1)"),
        wp.uint8: ("wp::uint8", "unsigned short", "static_cast<unsigned short>(code(v0) | code(v1) << 8)"),
    }[dtype]
    names = f"using Value = {value}; using Pair = {pair};\n"
    names += f"auto pair_of = [&](real v0, real v1) {{ return {word}; }};\n"
    return names + paste(NATIVE / "store_tile.cuh", CHANNELS=channels)
