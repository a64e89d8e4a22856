"""CUDA text of networks of rows of memory by warpgroups (`wgmma`, sm_90a).

Blocks stay: each copies the weights to shared memory once, then its warpgroups take 64 rows after each other. A warp
reads its own 16 rows while those before are multiplied. Vectors stay in registers from the first layer to the last, as
`wgmma` leaves results the way it takes its first operand.

Names as in `fragments`, with one tile `m`: the 64 rows of a warpgroup, 16 of them in each of its warps.
"""

from dataclasses import dataclass

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.cuda import primitives
from warp_neural.kernels.coopvec.cuda.fragments import bias_words
from warp_neural.kernels.coopvec.cuda.network import pre_activation, to_next, to_output
from warp_neural.kernels.coopvec.cuda.warpgroups import (
    PRODUCTS,
    PUBLISH,
    ROW,
    panel_of,
    panels_of,
    stage_weights,
    wait,
    wgmma,
)
from warp_neural.kernels.coopvec.layout import LayerLayout, bias_joins_relu, network_layout
from warp_neural.kernels.native import paste, unroll
from warp_neural.kernels.nn.spec import FLOAT16, NetworkSpec

WIDTHS = (32, 64, 128)  # of all hidden layers
MAX_IN, MAX_OUT = 128, 16
TILE = 64  # rows of a product
# Warpgroups of a block and blocks of a multiprocessor, by neurons and sums: the fastest of those that registers hold
SHAPES = {
    (32, "float16"): (4, 2),
    (32, "float32"): (2, 3),
    (64, "float16"): (2, 3),
    (64, "float32"): (4, 1),
    (128, "float16"): (5, 1),
    (128, "float32"): (2, 1),
}


@dataclass(frozen=True)
class RowsLayer:
    """weights: where they begin in shared memory, in bytes."""

    layout: LayerLayout
    weights: int


@dataclass(frozen=True)
class RowsSchedule:
    """groups: warpgroups of a block. blocks: of a multiprocessor. rows: where the warps' rows begin in shared memory,
    in bytes behind the first multiple of 1024."""

    layers: tuple[RowsLayer, ...]
    rows: int
    groups: int
    blocks: int

    arch_suffix = "a"  # `wgmma` only exists in code for exactly one architecture

    @property
    def threads(self) -> int:
        """Of a block."""
        return 128 * self.groups

    @property
    def block_rows(self) -> int:
        """That a block takes at a time."""
        return TILE * self.groups

    @property
    def warp_bytes(self) -> int:
        """Of a warp's rows: inputs, and 16 results of each of 16."""
        return panels_of(self.layers[0].layout) * 16 * ROW + 16 * 2 * MAX_OUT

    @property
    def words(self) -> int:
        """Of a block's shared memory."""
        return (1024 + self.rows + 4 * self.groups * self.warp_bytes) // 4


def make_rows_schedule(spec: NetworkSpec, arch: int, shared_bytes: int) -> RowsSchedule | None:
    """For a device of architecture `arch` whose blocks have so much shared memory; None: not for this way."""
    width = spec.sizes[1]
    kind = spec.format is FLOAT16 and spec.dtype is wp.float16 and arch == 90
    sizes = len(spec.sizes) > 2 and width in WIDTHS and set(spec.sizes[1:-1]) == {width}
    if not (kind and sizes and spec.sizes[0] % 16 == 0 and spec.sizes[0] <= MAX_IN and spec.sizes[-1] <= MAX_OUT):
        return None
    weights, layers = 0, []
    for layout in network_layout(spec, True)[0]:
        layers.append(RowsLayer(layout, weights))
        weights += panels_of(layout) * panel_of(layout)
    schedule = RowsSchedule(tuple(layers), weights, *SHAPES[width, spec.accumulation])
    return schedule if 4 * schedule.words <= shared_bytes else None


def rows_by_warpgroups_text(spec: NetworkSpec, schedule: RowsSchedule) -> str:
    """`(params, memory, x, y)`: the network of every row of x, to y. All threads of all blocks."""
    layers = schedule.layers
    first, last = layers[0].layout, layers[-1].layout
    kind, registers = primitives.accumulator(spec)
    halves, width, blocks = registers == 2, spec.sizes[1], max(first.k_pad, spec.sizes[1]) // 16
    constants = {"IN_UNITS": first.k // 8, "N_OUT": spec.sizes[-1]}
    hidden = "".join(activate(spec, schedule, index) for index in range(len(layers) - 1))
    return unroll(f"""{primitives.prelude(spec)}{primitives.MATRICES}{PRODUCTS}
{wgmma("multiply_hidden", spec, width, "registers", False, halves)}
{wgmma("multiply_last", spec, last.n_pad, "registers", False, halves)}
const unsigned warp = __shfl_sync(0xffffffffu, threadIdx.x >> 5, 0), group = warp >> 2;
const unsigned weights = (static_cast<unsigned>(__cvta_generic_to_shared(memory.data.ptr)) + 1023u) & ~1023u;
const unsigned rows = weights + {schedule.rows} + warp * {schedule.warp_bytes};
{paste(NATIVE / "rows_of_warp.cuh", **constants)}
const unsigned stride = gridDim.x * {schedule.block_rows};
unsigned start = blockIdx.x * {schedule.block_rows} + group * {TILE} + warp % 4u * 16u;  // of this warp
fetch(start);
{{ {stage_weights(spec, layers, schedule.threads)}{PUBLISH}}}
const unsigned* const base = params.packed.data + static_cast<size_t>(params.network) * {network_layout(spec, True)[1]};
const unsigned at = 0u;
const integer j0 = 0;
for (; start - warp % 4u * 16u < n; start += stride) {{
asm volatile("cp.async.wait_all;" ::: "memory");
__syncwarp();
constexpr int m = 0;
unsigned a[1][{blocks}][4];
{kind} d[1][{width // 8}][{registers}], z[1][{last.n_pad // 8}][{registers}];
UNROLL for (int b = 0; b < {first.k_pad // 16}; ++b) take(b, a[m][b]);
__syncwarp();
if (start + stride < n) fetch(start + stride);
{products(spec, schedule, 0)}{hidden}{results(spec, schedule)}}}
asm volatile("cp.async.wait_all;" ::: "memory");
""")


def flat(spec: NetworkSpec, array: str, tiles: int) -> str:
    """The accumulators of one tile, one register after the other."""
    kind, registers = primitives.accumulator(spec)
    return f"(*reinterpret_cast<{kind} (*)[{registers * tiles}]>(&{array}))"


def products(spec: NetworkSpec, schedule: RowsSchedule, index: int) -> str:
    """Layer `index`, under way as a group."""
    layer, last = schedule.layers[index], index == len(schedule.layers) - 1
    layout, array = layer.layout, "z[m]" if last else "d[m]"
    starts_from_bias = not bias_joins_relu(spec, last)
    kind, registers = primitives.accumulator(spec)
    start = f"""UNROLL for (int j = 0; j < {layout.n_pad // 8}; ++j) {{
{kind} (&c)[{registers}] = {array}[j];
UNROLL for (int h = 0; h < 2; ++h) {{ {bias_words(spec, layout, "j", "base")} }} }}
"""
    multiply = f"multiply_{'last' if last else 'hidden'}({flat(spec, array, layout.n_pad // 8)}, a[m][b]"
    tile = f"tile(weights + {layer.weights} + b / 4 * {panel_of(layout)} + 32 * (b % 4), 0u)"
    return f"""{start if starts_from_bias else ""}begin_products();
UNROLL for (int b = 0; b < {layout.k_pad // 16}; ++b)
    {multiply}, {tile}, {"1" if starts_from_bias else "b"});
commit();
"""


def await_sums(spec: NetworkSpec, array: str, tiles: int) -> str:
    constraint = "f" if primitives.accumulator(spec)[0] == "real" else "r"
    return wait(0, flat(spec, array, tiles), constraint=constraint)


def activate(spec: NetworkSpec, schedule: RowsSchedule, index: int) -> str:
    """Results of layer `index` become the input of the next, whose products begin."""
    layout = schedule.layers[index].layout
    tiles = layout.n_pad // 8
    biases, finish = "", to_next(spec, layout)
    if bias_joins_relu(spec, False):
        biases = f"""unsigned bias[{tiles}];
UNROLL for (int j = 0; j < {tiles}; ++j) {{ unsigned c[1]; const int h = 0;
{bias_words(spec, layout, "j", "base")}
bias[j] = c[0]; }}
"""
        finish = "next[m][j / 2][j % 2 * 2 + h] = half_add_relu(d[m][j][h], bias[j]);"
    return f"""{{ {biases}{pre_activation(spec, layout)}auto& next = a;
{await_sums(spec, "d[m]", tiles)}
UNROLL for (int j = 0; j < {tiles}; ++j) UNROLL for (int h = 0; h < 2; ++h) {{ {finish} }}
{products(spec, schedule, index + 1)}}}
"""


def results(spec: NetworkSpec, schedule: RowsSchedule) -> str:
    """Those of the last layer, to memory."""
    layout = schedule.layers[-1].layout
    tiles = layout.n_pad // 8
    return f"""{{ auto& d = z;
{pre_activation(spec, layout)}
{await_sums(spec, "z[m]", tiles)}
unsigned o[1][2][2];
o[m][1][0] = o[m][1][1] = 0u;
UNROLL for (int j = 0; j < {tiles}; ++j) UNROLL for (int h = 0; h < 2; ++h) {{ {to_output(spec)} }}
const unsigned w[4] = {{o[m][0][0], o[m][0][1], o[m][1][0], o[m][1][1]}};
leave(start, w);
}}
"""
