"""CUDA text of a fused training step for 128 neurons a layer: the backward pass, as `warpgroup_backward`, and sums."""

from kernels.activations import leaky_relu, linear, relu
from kernels.coopvec.fragments import unrolled
from kernels.coopvec.spec import NetworkSpec
from kernels.training.warpgroup import wait, wgmma
from kernels.training.warpgroup_backward import enter_finish, leave_last, put_last, start
from kernels.training.warpgroup_plan import GROUPS, LAST_ROW, ROW
from kernels.training.wide import BLOCKS, enter
from kernels.training.wide_plan import MASKS, PANEL, SAMPLES, WidePlan


def upper_layers(spec: NetworkSpec, plan: WidePlan) -> str:
    """`(memory, sums, z, dy) -> sums`: dz of all layers from `low` on, dW of `high` if it is not `low`. All threads."""
    layers = "".join(backward_layer(spec, plan, index) for index in reversed(range(plan.low + 1, len(plan.layers))))
    gradients = "".join(weight_multiply(spec, plan, index) for index in plan.gradients if index > plan.low)
    count = len(plan.layers)
    bias_sums = plan.first_sum(count - 1) + plan.layers[-1].registers if plan.high == count - 1 else None
    return unrolled(f"""{enter(spec, plan)}{wgmma("multiply_back", spec, 64, True, True)}{gradients}
auto sum = sums;
unsigned dz[1][{BLOCKS}][4];
real dh[2][32];
{start(spec, plan.last_dz, 1, bias_sums)}
{layers}publish();
return sum;
""")


def weight_multiply(spec: NetworkSpec, plan: WidePlan, index: int) -> str:
    layer = plan.layers[index]
    bias = "" if layer.last else wgmma(f"multiply_ones_{index}", spec, 8, False, True)
    return wgmma(f"multiply_{index}", spec, layer.columns, False, True) + bias


def weight_products(plan: WidePlan, index: int) -> str:
    """This warpgroup's rows of dW of layer `index`, under way, from the samples of both."""
    layer, sums = plan.layers[index], plan.first_sum(index)
    h, dz = f"from + {plan.h(index)}", f"from + {plan.dz(index)}"
    if layer.last:
        a, b = f"tile({h} + group * {PANEL} + {16 * ROW} * s, 0u)", f"last_tile({dz} + {16 * LAST_ROW} * s)"
    else:
        a, b = f"tile({dz} + group * {PANEL} + {16 * ROW} * s, 0u)", f"tile({h} + {16 * ROW} * s, {PANEL}u)"
    dw = f"(*reinterpret_cast<real (*)[{layer.registers}]>(sum.c + {sums}))"
    db = f"(*reinterpret_cast<real (*)[4]>(sum.c + {sums + layer.registers}))"
    bias = "" if layer.last else f"multiply_ones_{index}({db}, {a}, tile(ones, 0u), 1);"
    return f"""for (int source = 0; source < {GROUPS}; ++source) for (int s = 0; s < {SAMPLES // 16}; ++s) {{
    const unsigned from = areas + source * {plan.area};
    multiply_{index}({dw}, {a}, {b}, 1);
    {bias}
}}
"""


def backward_layer(spec: NetworkSpec, plan: WidePlan, index: int) -> str:
    """dz of layer `index`, in registers and if its gradient is due in shared memory, to that of the layer before."""
    layer, due = plan.layers[index], index in plan.gradients
    gradient = f"publish();\n__syncthreads();\nbegin_products();\n{weight_products(plan, index)}commit();\n"
    word = "pack(dh[half][8 * i + 2 * r], dh[half][8 * i + 2 * r + 1])"
    if spec.activation is relu:
        word += " & spread_signs(mask[half] << (4 * i + r))"
    elif spec.activation is leaky_relu:
        values = (
            f"dh[half][8 * i + 2 * r + {e}] * d_hidden(mask[half] >> ({15 + 16 * e} - (4 * i + r)) & 1u ? 1.0f : -1.0f)"
            for e in range(2)
        )
        word = f"pack({', '.join(values)})"
    masks = f"""unsigned mask[2];
asm volatile("ld.shared.v2.b32 {{%0,%1}},[%2];"
    : "=r"(mask[0]), "=r"(mask[1]) : "r"(masks + {(index - 1) * MASKS}) : "memory");
"""
    save = f"save(matrices({plan.dz(index - 1)}, b), dz[0][b]);" if index - 1 in plan.gradients else ""
    return f"""{{ const unsigned panels = weights + {layer.weights};
begin_products();
for (int half = 0; half < 2; ++half) {{
    for (int b = 0; b < {1 if layer.last else BLOCKS}; ++b)
        multiply_back(dh[half], dz[0][b], tile(panels + half * {layer.panel} + {16 * ROW} * b, 0u), b);
    commit();
}}
{gradient if due else ""}{"" if spec.activation is linear else masks}unsigned next[{BLOCKS}][4];
for (int half = 0; half < 2; ++half) {{
if (half == 0) {{ {wait(1 + due, "dh[0]")} }} else {{ {wait(int(due), "dh[1]")} }}
for (int i = 0; i < 4; ++i) for (int r = 0; r < 4; ++r) next[4 * half + i][r] = {word};
}}
{wait(0, "sum.c") + "__syncthreads();" if due else ""}
for (int b = 0; b < {BLOCKS}; ++b) {{ for (int r = 0; r < 4; ++r) dz[0][b][r] = next[b][r]; {save} }}
}}
"""


def first_layer(spec: NetworkSpec, plan: WidePlan, input_gradient: bool) -> str:
    """`(memory, sums) -> sums`: dW of layer `low`; `input_gradient` (layer 0) leaves dx where x was. All threads."""
    layer, k_pad = plan.layers[0], plan.layers[0].layout.k_pad
    before = after = lambdas = ""
    if input_gradient:
        lambdas = wgmma("multiply_back", spec, k_pad, True, True)
        before = f"""unsigned dz[1][{BLOCKS}][4];
real dh[{k_pad // 2}];
for (int b = 0; b < {BLOCKS}; ++b) load(matrices({plan.dz(0)}, b), dz[0][b]);
begin_products();
for (int b = 0; b < {BLOCKS}; ++b)
    multiply_back(dh, dz[0][b], tile(weights + {layer.weights} + {16 * ROW} * b, {layer.panel}u), b);
commit();
"""
        after = f"""for (int b = 0; b < {k_pad // 16}; ++b) {{
    unsigned w[4];
    for (int r = 0; r < 4; ++r) w[r] = pack(dh[8 * b + 2 * r], dh[8 * b + 2 * r + 1]);
    save(matrices(0, b), w);
}}
"""
    ready = ("sum.c", "dh") if input_gradient else ("sum.c",)
    return unrolled(f"""{enter(spec, plan)}{lambdas}{weight_multiply(spec, plan, plan.low)}
auto sum = sums;
{before}__syncthreads();
begin_products();
{weight_products(plan, plan.low)}commit();
{wait(0, *ready)}__syncthreads();
{after}return sum;
""")


def finish(plan: WidePlan) -> str:
    """As `cuda_finish.finish`, of the pass's layers; the last layer's pass leaves the loss."""
    final, text, checked = plan.layers[-1], "", []
    for index in plan.gradients:
        layer, sums = plan.layers[index], plan.first_sum(index)
        for r in range(layer.registers):
            text += f"put({layer.first} + (group * {layer.registers}u + {r}u) * 128u + place, sums.c[{sums + r}]);\n"
        biases = [sums + layer.registers + r for r in ((0,) if layer.last else (0, 2))]
        checked += [*range(sums, sums + layer.registers), *biases]
        for h, i in enumerate(biases if not layer.last else ()):
            row = f"group * 64u + place / 32u * 16u + g + {8 * h}"
            text += f"if (t == 0u) put({layer.bias_first} + {row}, sums.c[{i}]);\n"
    if plan.layers[plan.high].last:
        bias_sums = plan.first_sum(plan.high) + final.registers
        text += f"__syncthreads();\n{leave_last(plan, 0, bias_sums)}__syncthreads();\n{put_last(plan, 0)}"
    return unrolled(enter_finish(plan, checked) + text)
