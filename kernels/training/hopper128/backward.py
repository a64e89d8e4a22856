"""CUDA text of a fused training step for 128 neurons a layer: the upper pass's way back, and the sums of a pass."""

from warp_neural.kernels.coopvec.cuda.warpgroups import wait, wgmma
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.backward import back_word, start
from warp_neural.kernels.training.hopper64.finish import enter_finish, leave_last, put_last
from warp_neural.kernels.training.hopper64.schedule import GROUPS, LAST_ROW, ROW
from warp_neural.kernels.training.hopper128.forward import BLOCKS, READ, enter, keep
from warp_neural.kernels.training.hopper128.schedule import PANEL, SAMPLES, SLOT, Hopper128Pass, Hopper128Schedule


def upper_layers_text(spec: NetworkSpec, schedule: Hopper128Schedule) -> str:
    """`(memory, sums, z, dy, kept, start) -> sums`: dz of the last two layers and, to memory, of the one before; dW of
    the last. All threads.
    """
    last, low = len(schedule.layers) - 1, schedule.low
    below = ""
    if low > 0:
        slot = schedule.h(last)  # free as soon as both warpgroups have their rows of dW
        words = back_words(spec, schedule.h(low), 0)
        below = f"""{back_products(schedule, low)}{words}{wait(0, "sum.c")}__syncthreads();
{save_next(slot)}keep({slot}, {SLOT // PANEL}, 0);
"""
    return f"""{enter(spec, schedule)}{keep(schedule)}{wgmma("multiply_back", spec, 64, "registers", True)}
{weight_multiply(spec, schedule, last)}
auto sum = sums;
unsigned dz[1][{BLOCKS}][4], next[{BLOCKS}][4];
real dh[2][32];
{start(spec, schedule.last_dz, 1, schedule.first_sum(last) + schedule.layers[-1].registers)}
{back_products(schedule, last)}__syncthreads();
begin_products();
{weight_products(schedule, last)}commit();
{back_words(spec, schedule.h(last), 1)}{save_next(schedule.dz(low))}
UNROLL for (int b = 0; b < {BLOCKS}; ++b) UNROLL for (int r = 0; r < 4; ++r) dz[0][b][r] = next[b][r];
{below}{wait(0, "sum.c")}publish();
return sum;
"""


def back_products(schedule: Hopper128Schedule, index: int) -> str:
    """dh = dz W of layer `index`, under way, half by half."""
    layer = schedule.layers[index]
    return f"""begin_products();
UNROLL for (int half = 0; half < 2; ++half) {{
    UNROLL for (int b = 0; b < {1 if layer.last else BLOCKS}; ++b)
        multiply_back(dh[half], dz[0][b], {back_tile(schedule, index)}, b);
    commit();
}}
"""


def back_tile(schedule: Hopper128Pass, index: int) -> str:
    """Rows 16 b on of W, for the inputs of `half`."""
    layer = schedule.layers[index]
    return f"tile(weights + {layer.weights} + half * {layer.panel} + {16 * ROW} * b, 0u)"


def back_words(spec: NetworkSpec, h: int, pending: int) -> str:
    """`next`: dh, of which two groups are under way and `pending` after them, times the slopes at what is in slot h."""
    word = back_word(spec, "dh[half][8 * i + 2 * r", "was[i][r]")
    return f"""UNROLL for (int half = 0; half < 2; ++half) {{
unsigned was[4][4];
UNROLL for (int i = 0; i < 4; ++i) load(matrices({h}, 4 * half + i), was[i]);
if (half == 0) {{ {wait(1 + pending, "dh[0]")} }} else {{ {wait(pending, "dh[1]")} }}
UNROLL for (int i = 0; i < 4; ++i) UNROLL for (int r = 0; r < 4; ++r) next[4 * half + i][r] = {word};
}}
"""


def save_next(slot: int) -> str:
    return f"UNROLL for (int b = 0; b < {BLOCKS}; ++b) save(matrices({slot}, b), next[b]);\n"


def weight_multiply(spec: NetworkSpec, schedule: Hopper128Pass, index: int) -> str:
    layer = schedule.layers[index]
    bias = "" if layer.last else wgmma(f"multiply_ones_{index}", spec, 8, "columns", True)
    return wgmma(f"multiply_{index}", spec, layer.columns, "columns", True) + bias


def weight_products(schedule: Hopper128Pass, index: int) -> str:
    """This warpgroup's rows of dW of layer `index`, under way, from the samples of both."""
    layer, sums = schedule.layers[index], schedule.first_sum(index)
    h, dz = f"from + {schedule.h(index)}", f"from + {schedule.dz(index)}"
    if layer.last:
        a, b = f"tile({h} + group * {PANEL} + {16 * ROW} * s, 0u)", f"last_tile({dz} + {16 * LAST_ROW} * s)"
    else:
        a, b = f"tile({dz} + group * {PANEL} + {16 * ROW} * s, 0u)", f"tile({h} + {16 * ROW} * s, {PANEL}u)"
    dw = f"(*reinterpret_cast<real (*)[{layer.registers}]>(sum.c + {sums}))"
    db = f"(*reinterpret_cast<real (*)[4]>(sum.c + {sums + layer.registers}))"
    bias = "" if layer.last else f"multiply_ones_{index}({db}, {a}, tile(ones, 0u), 1);"
    return f"""UNROLL for (int source = 0; source < {GROUPS}; ++source)
UNROLL for (int s = 0; s < {SAMPLES // 16}; ++s) {{
    const unsigned from = areas + source * {schedule.area};
    multiply_{index}({dw}, {a}, {b}, 1);
    {bias}
}}
"""


def begin_first_layer_text(spec: NetworkSpec, schedule: Hopper128Schedule) -> str:
    """As `hopper64.backward.begin_first_layer_text`, of layer `low`."""
    return f"""{enter(spec, schedule)}{weight_multiply(spec, schedule, schedule.low)}
auto sum = sums;
__syncthreads();
begin_products();
{weight_products(schedule, schedule.low)}commit();
return sum;
"""


def first_layer_text(spec: NetworkSpec, schedule: Hopper128Schedule, input_gradient: bool) -> str:
    """As `hopper64.backward.first_layer_text`."""
    k_pad = schedule.layers[0].layout.k_pad
    before = after = lambdas = ""
    if input_gradient:
        lambdas = wgmma("multiply_back", spec, k_pad, "registers", True)
        before = f"""unsigned dz[{BLOCKS}][4];
real dh[{k_pad // 2}];
UNROLL for (int b = 0; b < {BLOCKS}; ++b) load(matrices({schedule.dz(0)}, b), dz[b]);
begin_products();
UNROLL for (int b = 0; b < {BLOCKS}; ++b) multiply_back(dh, dz[b], {input_tile(schedule)}, b);
commit();
"""
        after = save_dx(schedule)
    ready = ("sum.c", "dh") if input_gradient else ("sum.c",)
    return f"""{enter(spec, schedule)}{lambdas}
auto sum = sums;
{before}{wait(0, *ready)}__syncthreads();
{after}return sum;
"""


def input_tile(schedule: Hopper128Pass) -> str:
    """Rows 16 b on of the first layer's W."""
    layer = schedule.layers[0]
    return f"tile(weights + {layer.weights} + {16 * ROW} * b, {layer.panel}u)"


def save_dx(schedule: Hopper128Pass) -> str:
    """`dh`, the gradient to the inputs, to their slot."""
    return f"""UNROLL for (int b = 0; b < {schedule.layers[0].layout.k_pad // 16}; ++b) {{
    unsigned w[4];
    UNROLL for (int r = 0; r < 4; ++r) w[r] = pack(dh[8 * b + 2 * r], dh[8 * b + 2 * r + 1]);
    save(matrices({schedule.dx}, b), w);
}}
"""


def finish_text(schedule: Hopper128Pass) -> str:
    """As `mma.finish.finish_text`, of the pass's layers; the upper pass leaves the loss."""
    text, checked = "", []
    for index in schedule.gradients:
        layer, sums = schedule.layers[index], schedule.first_sum(index)
        for r in range(layer.registers):
            text += f"put({layer.first} + (group * {layer.registers}u + {r}u) * 128u + place, sums.c[{sums + r}]);\n"
        biases = [sums + layer.registers + r for r in ((0,) if layer.last else (0, 2))]
        checked += [*range(sums, sums + layer.registers), *biases]
        for h, i in enumerate(biases if not layer.last else ()):
            row = f"group * 64u + place / 32u * 16u + g + {8 * h}"
            text += f"if (t == 0u) put({layer.bias_first} + {row}, sums.c[{i}]);\n"
        if layer.last:
            text += f"__syncthreads();\n{leave_last(schedule, 0, biases[0])}__syncthreads();\n{put_last(schedule)}"
            text += READ if schedule.kept else ""
    return enter_finish(schedule, checked) + text
