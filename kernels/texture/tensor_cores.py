"""Whole pictures of a neural texture on tensor cores: a warp decodes 8 x 4 texels, all in registers.

The features of a 2 x 2 block of texels, which is in one cell of every grid, are sums of float16 in the lanes that hold
them as the operand of `mma.sync`. Hidden layers sum in float16 too, the last in float32. Channels of each grid are
padded to slabs of 8 columns of the first layer, two slabs a product.
"""

from functools import cache
from pathlib import Path
from typing import Any

import warp as wp

from warp_neural.kernels.coopvec import NATIVE as COOPVEC
from warp_neural.kernels.coopvec.cuda.primitives import mma
from warp_neural.kernels.native import paste, unroll
from warp_neural.kernels.nn.spec import FLOAT16, round_up
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.kernels.texture.taps import make_taps
from warp_neural.kernels.texture.tensor_layout import TensorLayout

NATIVE = Path(__file__).parent / "native"
TILE_WIDTH, TILE_HEIGHT = 8, 4  # texels of a warp
BLOCK = 128


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
def make_tensor_decode_kernel(layout: TensorLayout, params_type: Any, dtype: type) -> wp.Kernel:
    """Texels of a rectangle (left, top, width, height) of a level to `values` [height, width, channels], contiguous:
    `wp.float32`, `wp.float16`, or `wp.uint8`, 0 to 255 as 0 to 1. dim: `tensor_dim`. For CUDA from sm_80 on."""

    @wp.func_native(f"#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800\n{tile_text(layout, dtype)}\n#endif\n")
    def decode_tile(
        params: params_type,
        tables: wp.array[wp.float16],
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
        tables: wp.array[wp.float16],
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


def tile_text(layout: TensorLayout, dtype: type) -> str:
    """The body of `decode_tile`."""
    spec = layout.spec
    products = mma("multiply", FLOAT16, "unsigned") + mma("multiply_last", FLOAT16, "real")
    names = f"{paste(COOPVEC / 'lanes.cuh')}{paste(COOPVEC / 'halves.cuh')}{products}"
    names += paste(NATIVE / "decode_tile.cuh", GRIDS=len(spec.grids), LEVEL_BIASES=layout.biases[-1])
    grids = "".join(grid_text(layout, g, grid) for g, grid in enumerate(spec.grids))
    layers = "".join(layer_text(layout, l) for l in range(1, len(spec.hidden)))
    return unroll(f"{names}{grids}{first_layer_text(layout)}{layers}{last_layer_text(layout, dtype)}")


def grid_text(layout: TensorLayout, g: int, grid: Grid) -> str:
    """Its numbers as a type, and the cells that the block reads."""
    numbers = {"INDEX": g, "SCALE": grid.scale, "CHANNELS": grid.channels, "BITS": grid.resident_bits}
    numbers |= {"LIMIT": grid.limit, "TABLE": layout.tables[g]}
    fields = ", ".join(f"{name} = {value}" for name, value in numbers.items())
    return f"struct Grid{g} {{ enum {{ {fields} }}; }};\nunsigned cells{g}[4];\nlocate(Grid{g}(), cells{g});\n"


PRODUCTS = """UNROLL for (int i = 0; i < 2; ++i) UNROLL for (int m = 0; m < 2; ++m)
    multiply{last}({c}[i], {start}, {a}, i ? w.z : w.x, i ? w.w : w.y);
"""


def first_layer_text(layout: TensorLayout) -> str:
    """`a0`, the operand of the next layer; features of one product's inputs at a time are made and multiplied."""
    slabs = [(g, s) for g, count in enumerate(layout.slabs) for s in range(count)]
    pairs = layout.sizes[1] // 16
    text = f"unsigned a0[2][{pairs}][4];\n{{ Sum c[2][{pairs}][2];\n"
    for block in range(layout.sizes[0] // 16):
        some = enumerate(slabs[2 * block : 2 * block + 2])
        features = "".join(f"features_of(Grid{g}(), {s}, cells{g}, f[{k}]);\n" for k, (g, s) in some)
        start = start_text(0) if block == 0 else ""
        products = PRODUCTS.format(last="", c="c[m][j]", start="start[i]" if block == 0 else "c[m][j][i]", a="a[m]")
        text += f"""{{ unsigned f[2][4] = {{}}, a[2][4];
{features}put_features(f, a);
UNROLL for (int j = 0; j < {pairs}; ++j) {{ const uint4 w = weights_at({block * pairs} + j); {start}{products}}} }}
"""
    return f"""{text}UNROLL for (int j = 0; j < {pairs}; ++j) UNROLL for (int m = 0; m < 2; ++m)
    put_outputs(c[m][j], a0[m][j]);
}}
"""


def start_text(biases: int, last: str = "") -> str:
    places = f"begin{last}(biases_at({biases}, 2 * j + i), start[i]);"
    return f"{'LastSum' if last else 'Sum'} start[2]; UNROLL for (int i = 0; i < 2; ++i) {places}\n"


def products_text(layout: TensorLayout, l: int, last: str = "") -> str:
    """`c`, the sums of layer l and outputs 16 j to 16 j + 15. last: "_last" of the last one."""
    products = PRODUCTS.format(last=last, c="c[m]", start="b == 0 ? start[i] : c[m][i]", a=f"a{l - 1}[m][b]")
    return f"""{"LastSum" if last else "Sum"} c[2][2];
{start_text(layout.biases[l], last)}UNROLL for (int b = 0; b < {layout.sizes[l] // 16}; ++b) {{
const uint4 w = weights_at({layout.weights[l]} + b * {layout.sizes[l + 1] // 16} + j);
{products}}}
"""


def layer_text(layout: TensorLayout, l: int) -> str:
    """Hidden layer l, 16 outputs at a time: from the operand `a{l - 1}` to `a{l}`."""
    return f"""unsigned a{l}[2][{layout.sizes[l + 1] // 16}][4];
UNROLL for (int j = 0; j < {layout.sizes[l + 1] // 16}; ++j) {{
{products_text(layout, l)}UNROLL for (int m = 0; m < 2; ++m) put_outputs(c[m], a{l}[m][j]);
}}
"""


def last_layer_text(layout: TensorLayout, dtype: type) -> str:
    return f"""{{ constexpr int j = 0;
{products_text(layout, len(layout.spec.hidden), "_last")}{store_text(layout.spec.channels, dtype)}}}
"""


def store_text(channels: int, dtype: type) -> str:
    """Of the sums `c` those inside the rectangle to `values`: channels 8 i + 2 t and the next, in one piece if the
    number of channels is even."""
    value, pair, word = {
        wp.float32: ("wp::float32", "float2", "make_float2(v0, v1)"),
        wp.float16: ("wp::float16", "unsigned", "half_pack(v0, v1)"),
        wp.uint8: ("wp::uint8", "unsigned short", "static_cast<unsigned short>(code(v0) | code(v1) << 8)"),
    }[dtype]
    names = f"using Value = {value}; using Pair = {pair};\n"
    names += f"auto pair_of = [&](real v0, real v1) {{ return {word}; }};\n"
    return names + paste(NATIVE / "store_tile.cuh", CHANNELS=channels)
