"""CUDA text of a fused training step by warpgroups for 128 neurons a layer, as in `hopper64`: the forward pass.

A tile is 64 samples, of which each warp has 16 rows and as many of its lanes their own.
"""

from pathlib import Path

from warp_neural.kernels.coopvec.cuda import primitives
from warp_neural.kernels.coopvec.cuda.warpgroups import PRODUCTS, wait, wgmma
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.activations import linear, relu
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.forward import (
    read_biases,
    read_results,
    save_inputs,
    save_results,
)
from warp_neural.kernels.training.hopper64.schedule import ROW
from warp_neural.kernels.training.hopper128.schedule import (
    PANEL,
    SLOT,
    WIDTH,
    Hopper128Layer,
    Hopper128Pass,
    Hopper128Schedule,
)
from warp_neural.kernels.training.text import slopes

NATIVE = Path(__file__).parent / "native"

BLOCKS = WIDTH // 16  # of inputs, in one product


def enter(spec: NetworkSpec, schedule: Hopper128Pass) -> str:
    """As `hopper64.forward.enter`; `areas` of both warpgroups."""
    where = {"ONES": schedule.ones, "AREAS": schedule.areas, "AREA": schedule.area}
    places = paste(NATIVE / "places.cuh", ROW=ROW, PANEL=PANEL, **where)
    return f"{primitives.prelude(spec)}{slopes(spec)}{primitives.MATRICES}{PRODUCTS}{places}"


def keep(schedule: Hopper128Schedule) -> str:
    """A lambda, after `enter`: rows of a slot to the tile in memory."""
    return paste(NATIVE / "keep.cuh", KEPT=schedule.kept * SLOT) if schedule.kept else ""


# before a slot is written again of which `keep` took a copy
READ = 'if (lane == 0) asm volatile("cp.async.bulk.wait_group.read 0;" ::: "memory");\n__syncwarp();\n'


def forward_text(spec: NetworkSpec, schedule: Hopper128Schedule, halves: bool) -> str:
    """As `hopper64.forward.forward_text`. The inputs of the layers before `schedule.low` are kept in memory."""
    final, k_pad, depth = schedule.layers[-1].layout, schedule.layers[0].layout.k_pad, len(schedule.layers) - 1
    layers = "".join(forward_layer(spec, schedule, index) for index in range(depth))
    multiply = wgmma("multiply_hidden", spec, 64, "registers", False)
    multiply += wgmma("multiply_last", spec, final.n_pad, "registers", False)
    return f"""{enter(spec, schedule)}{keep(schedule)}{multiply}{read_biases(schedule, WIDTH)}
if (lane < 16u) {{
{save_inputs(spec, schedule, halves)}}}
__syncwarp();
unsigned a[{BLOCKS}][4];
UNROLL for (int b = 0; b < {k_pad // 16}; ++b) load(matrices(0, b), a[b]);
{keep_input(schedule, 0, 0)}{layers}
real z[{final.n_pad // 2}];
begin_products();
UNROLL for (int b = 0; b < {BLOCKS}; ++b) {{
    const int half = 0;
    multiply_last(z, a[b], {weight_tile(schedule.layers[-1])}, b);
}}
commit();
{wait(0, "z")}
{save_results(schedule, "z", "")}{read_results(schedule)}"""


def keep_input(schedule: Hopper128Schedule, index: int, slot: int) -> str:
    """That of layer `index`, which lies in `slot`, if the lower pass needs it."""
    return (
        f"keep({slot}, {schedule.layers[index].panels}, {(schedule.low - index) * SLOT});\n"
        if index < schedule.low
        else ""
    )


def forward_layer(spec: NetworkSpec, schedule: Hopper128Schedule, index: int) -> str:
    """`a` becomes the input of the next layer, half of it while the other half is multiplied."""
    layer = schedule.layers[index]
    values = "d[half][4 * j + 2 * h] + biases[j].x", "d[half][4 * j + 2 * h + 1] + biases[j].y"
    if spec.activation is relu:
        word = "pack_relu({}, {})"
    else:
        word = "pack({}, {})" if spec.activation is linear else "pack(hidden({}), hidden({}))"
    slot = schedule.spare if index + 1 < schedule.low else schedule.h(index + 1)
    return f"""{{ real d[2][32];
begin_products();
UNROLL for (int half = 0; half < 2; ++half) {{
    UNROLL for (int b = 0; b < {layer.layout.k_pad // 16}; ++b)
        multiply_hidden(d[half], a[b], {weight_tile(layer)}, b);
    commit();
}}
unsigned next[{BLOCKS}][4];
UNROLL for (int half = 0; half < 2; ++half) {{
float2 biases[8];
UNROLL for (int j = 0; j < 8; ++j) biases[j] = read_biases({index}, 8 * half + j);
if (half == 0) {{ {wait(1, "d[0]")} }} else {{ {wait(0, "d[1]")} }}
UNROLL for (int j = 0; j < 8; ++j) UNROLL for (int h = 0; h < 2; ++h)
    next[4 * half + j / 2][j % 2 * 2 + h] = {word.format(*values)};
}}
{READ if schedule.kept and index + 1 == schedule.low else ""}UNROLL for (int b = 0; b < {BLOCKS}; ++b) {{
    UNROLL for (int r = 0; r < 4; ++r) a[b][r] = next[b][r];
    save(matrices({slot}, b), a[b]);
}}
}}
{keep_input(schedule, index + 1, slot)}"""


def weight_tile(layer: Hopper128Layer) -> str:
    """Columns 16 b on of W, for the neurons of `half`."""
    return f"tile(weights + {layer.weights} + b / 4 * {layer.panel} + half * {64 * ROW} + 32 * (b % 4), 0u)"
