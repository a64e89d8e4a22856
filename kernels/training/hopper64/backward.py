"""CUDA text of a fused training step by warpgroups: the backward pass.

From the last layer to the first, `dz` of a warp's rows passes through registers like vectors in the forward pass, and
a copy for the products of the weights' gradient through shared memory. The products of the first two layers come last:
while they run, the next samples can be read.
"""

from pathlib import Path

from warp_neural.kernels.coopvec.cuda.warpgroups import wait, wgmma
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.activations import linear, relu
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.forward import enter
from warp_neural.kernels.training.hopper64.schedule import (
    LAST_ROW,
    MAX_OUT,
    ROW,
    SAMPLES,
    SLOT,
    WIDTH,
    Hopper64Schedule,
    HopperSchedule,
)
from warp_neural.kernels.training.text import take_dx

NATIVE = Path(__file__).parent / "native"


def upper_layers_text(spec: NetworkSpec, schedule: Hopper64Schedule) -> str:
    """`(memory, sums, z, dy) -> sums`: dz of all layers, dW of all but the first two. All threads."""
    layers = "".join(backward_layer(spec, schedule, index) for index in reversed(range(1, len(schedule.layers))))
    gradients = "".join(weight_multiply(spec, schedule, index) for index in range(2, len(schedule.layers)))
    return f"""{enter(spec, schedule)}{wgmma("multiply_back", spec, WIDTH, "registers", True)}{gradients}
auto sum = sums;
unsigned dz[2][{WIDTH // 16}][4];
real dh[2][{WIDTH // 2}];
{start(spec, schedule.last_dz, 2, schedule.layers[-1].bias_sums)}
UNROLL for (int m = 0; m < 2; ++m) {{ {back_products(schedule, len(schedule.layers) - 1)} }}
{layers}publish();
return sum;
"""


def start(spec: NetworkSpec, last_dz: int, tiles: int, bias_sums: int) -> str:
    """The last layer's dz of each thread's own sample, to shared memory and `tiles` operands of this warp.

    bias_sums: the register for its sum over the warp."""
    n_out = spec.sizes[-1]
    values = ", ".join(f"dy.c[{n}] * d_last(z.c[{n}])" if n < n_out else "0.0f" for n in range(MAX_OUT))
    text = paste(NATIVE / "start.cuh", LAST_DZ=last_dz, LAST_ROW=LAST_ROW, TILES=tiles, BIAS_SUMS=bias_sums)
    return f"{{ real v[{MAX_OUT}] = {{{values}}};\n{text}}}\n"


def back_products(schedule: Hopper64Schedule, index: int) -> str:
    """dh[m] = dz[m] W of layer `index`, under way as a group."""
    layer = schedule.layers[index]
    return f"""begin_products();
UNROLL for (int b = 0; b < {1 if layer.last else WIDTH // 16}; ++b)
    multiply_back(dh[m], dz[m][b], tile(weights + {layer.weights} + {16 * ROW} * b, 0u), b);
commit();
"""


def weight_multiply(spec: NetworkSpec, schedule: Hopper64Schedule, index: int) -> str:
    return wgmma(f"multiply_{index}", spec, schedule.layers[index].columns, "columns", True)


def weight_products(schedule: Hopper64Schedule, index: int) -> str:
    """dW of layer `index`, under way: dz^T (H, ones); of the last layer H^T dz."""
    layer, h = schedule.layers[index], f"area + {index * SLOT} + {16 * ROW} * s"
    if layer.last:
        operands = f"tile({h}, 0u), last_tile(area + {schedule.last_dz} + {16 * LAST_ROW} * s)"
    else:
        operands = f"tile(area + {schedule.dz(index)} + {16 * ROW} * s, 0u), tile({h}, ones - ({h}))"
    dw = f"(*reinterpret_cast<real (*)[{layer.columns // 2}]>(sum.c + {layer.sums}))"
    return f"UNROLL for (int s = 0; s < {SAMPLES // 16}; ++s) multiply_{index}({dw}, {operands}, 1);\n"


def backward_layer(spec: NetworkSpec, schedule: Hopper64Schedule, index: int) -> str:
    """dz of layer `index`, whose way back is being multiplied, to that of the layer before."""
    before = "" if schedule.layers[index].last else f"publish();\n{wait(2)}"
    if len(schedule.layers) > 2:  # the slot that dz goes to is free now, and dz of this layer complete
        before += "together();\n"
    pending = (1, 0)
    if index > 1:
        before += f"begin_products();\n{weight_products(schedule, index)}commit();\n"
        pending = (2, 2)
    word = back_word(spec, "dh[m][8 * b + 2 * r", "kept[b][r]")  # row half r % 2, columns 8 (2 b + r / 2) + 2 t
    return f"""{before}
UNROLL for (int m = 0; m < 2; ++m) {{
unsigned kept[{WIDTH // 16}][4];
UNROLL for (int b = 0; b < {WIDTH // 16}; ++b) load(matrices({index * SLOT}, m, b), kept[b]);
if (m == 0) {{ {wait(pending[0], "dh[0]")} }} else {{ {wait(pending[1], "dh[1]")} }}
UNROLL for (int b = 0; b < {WIDTH // 16}; ++b) UNROLL for (int r = 0; r < 4; ++r) dz[m][b][r] = {word};
{back_products(schedule, index - 1) if index > 1 else ""}
UNROLL for (int b = 0; b < {WIDTH // 16}; ++b) save(matrices({schedule.dz(index - 1)}, m, b), dz[m][b]);
}}
"""


def back_word(spec: NetworkSpec, dh: str, kept: str) -> str:
    """`dh]` and the next, times the slopes at the activations `kept`, as one register."""
    low, high = f"{dh}]", f"{dh} + 1]"
    if spec.activation is relu:  # a positive half is not zero: then the sum's sign bit is set
        return f"pack({low}, {high}) & spread_signs({kept} + 0x7fff7fffu)"
    if spec.activation is linear:
        return f"pack({low}, {high})"
    return f"pack({low} * d_hidden(low({kept})), {high} * d_hidden(high({kept})))"


def begin_first_layer_text(spec: NetworkSpec, schedule: Hopper64Schedule) -> str:
    """`(memory, sums) -> sums`: dW of the first two layers, under way. All threads."""
    return f"""{enter(spec, schedule)}{weight_multiply(spec, schedule, 0)}{weight_multiply(spec, schedule, 1)}
auto sum = sums;
together();
begin_products();
{weight_products(schedule, 1)}{weight_products(schedule, 0)}commit();
return sum;
"""


def first_layer_text(spec: NetworkSpec, schedule: Hopper64Schedule, input_gradient: bool) -> str:
    """`(memory, sums) -> sums`, complete; `input_gradient` leaves dx where x was. All threads."""
    k_pad, blocks = schedule.layers[0].layout.k_pad, WIDTH // 16
    before = after = lambdas = ""
    if input_gradient:
        lambdas = wgmma("multiply_back", spec, k_pad, "registers", True)
        before = f"""unsigned dz[2][{blocks}][4];
real dh[2][{k_pad // 2}];
UNROLL for (int m = 0; m < 2; ++m)
UNROLL for (int b = 0; b < {blocks}; ++b) load(matrices({schedule.dz(0)}, m, b), dz[m][b]);
UNROLL for (int m = 0; m < 2; ++m) {{ {back_products(schedule, 0)} }}
"""
        after = f"""UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int b = 0; b < {k_pad // 16}; ++b) {{
    unsigned w[4];
    UNROLL for (int r = 0; r < 4; ++r) w[r] = pack(dh[m][8 * b + 2 * r], dh[m][8 * b + 2 * r + 1]);
    save(matrices(0, m, b), w);
}}
"""
    ready = ("sum.c", "dh[0]", "dh[1]") if input_gradient else ("sum.c",)
    return f"""{enter(spec, schedule)}{lambdas}
auto sum = sums;
{before}{wait(0, *ready)}together();
{after}return sum;
"""


def input_gradient_text(spec: NetworkSpec, schedule: HopperSchedule, enter: str, dtype: type) -> str:
    """As `mma.backward.input_gradient_text`. All threads. enter: what the text begins with."""
    take = take_dx(spec.sizes[0], dtype, lambda u: f"unit({schedule.dx}, {u})")
    return f"{enter}__syncwarp();\n{take}__syncwarp();\nreturn dx;\n"
