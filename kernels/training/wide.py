"""CUDA text of a fused training step by warpgroups for 128 neurons a layer; see `wide_plan` and `warpgroup`.

A tile is 64 samples, of which each warp has 16 rows and as many of its lanes their own. ReLU's slopes are kept as bits.
"""

from kernels.activations import leaky_relu, linear, relu
from kernels.coopvec import primitives
from kernels.coopvec.fragments import unrolled
from kernels.coopvec.spec import FLOAT16, NetworkSpec
from kernels.training.cuda import MEMORY, slopes
from kernels.training.warpgroup import PRODUCTS, input_word, wait, wgmma
from kernels.training.warpgroup_backward import start
from kernels.training.warpgroup_plan import GROUPS, LAST_ROW, ROW
from kernels.training.wide_plan import MASKS, PANEL, SAMPLES, WIDTH, WidePlan

BLOCKS = WIDTH // 16  # of inputs, in one product


def enter(spec: NetworkSpec, plan: WidePlan) -> str:
    """As `warpgroup.enter`; `areas` of both warpgroups."""
    return f"""{primitives.prelude(spec)}{slopes(spec)}{MEMORY}{PRODUCTS}
const unsigned warp = __shfl_sync(0xffffffffu, threadIdx.x >> 5, 0), group = warp >> 2;
const unsigned weights = (static_cast<unsigned>(__cvta_generic_to_shared(memory.data.ptr)) + 1023u) & ~1023u;
const unsigned ones = weights + {plan.ones}, areas = weights + {plan.areas}, area = areas + group * {plan.area};
const unsigned first = (warp & 3u) * 16, upper = lane >> 4, row = first + (lane & 15u), own = row;
const unsigned place = row * {ROW} + ((upper ^ (lane & 7u)) << 4);
const unsigned masks = area + {plan.masks} + (threadIdx.x & 127u) * 8;
auto unit = [&](unsigned slot, int u) {{
    return area + slot + u / 8 * {PANEL} + own * {ROW} + ((u % 8 ^ (lane & 7u)) << 4); }};
auto matrices = [&](unsigned slot, int b) {{ return area + slot + b / 4 * {PANEL} + (place ^ (b % 4 << 5)); }};
"""


def forward(spec: NetworkSpec, plan: WidePlan, halves: bool) -> str:
    """As `warpgroup.forward`."""
    n_in, n_out, final = spec.sizes[0], spec.sizes[-1], plan.layers[-1].layout
    k_pad, depth = plan.layers[0].layout.k_pad, len(plan.layers) - 1
    inputs = ""
    for u in range(k_pad // 8):
        words = ", ".join(input_word(n_in, 8 * u + 2 * t, halves and spec.format is FLOAT16) for t in range(4))
        inputs += f"save_unit(unit(0, {u}), {words});\n"
    layers = "".join(forward_layer(spec, plan, index) for index in range(depth))
    results = "".join(
        f"{{ unsigned v[4]; load_unit(unit({plan.spare}, {n // 4}), v);\n"
        + "".join(f"result.c[{i}] = __uint_as_float(v[{i % 4}]);\n" for i in range(n, min(n + 4, n_out)))
        + "}\n"
        for n in range(0, n_out, 4)
    )
    return unrolled(f"""{enter(spec, plan)}
{wgmma("multiply_hidden", spec, WIDTH, True, False)}{wgmma("multiply_last", spec, final.n_pad, True, False)}
auto read_biases = [&](int layer, int j) {{ float2 v;  // of neurons 8 j + 2 t and the next
    asm volatile("ld.shared.v2.f32 {{%0,%1}},[%2];" : "=f"(v.x), "=f"(v.y)
        : "r"(weights + {plan.biases} + {4 * WIDTH} * layer + 32 * j + 8 * t));
    return v; }};
if (lane < 16u) {{
{inputs}}}
__syncwarp();
unsigned a[{BLOCKS}][4];
for (int b = 0; b < {k_pad // 16}; ++b) load(matrices(0, b), a[b]);
{layers}
real z[{final.n_pad // 2}];
{products(plan, depth, "multiply_last(z")}
{wait(0, "z")}
for (int j = 0; j < {final.n_pad // 8}; ++j) {{
    const float2 bias = read_biases({depth}, j);
    const unsigned swizzled = area + {plan.spare} + ((2 * j + (t >> 1) ^ g) << 4) + (t & 1u) * 8;
    for (int h = 0; h < 2; ++h) asm volatile("st.shared.v2.f32 [%0],{{%1,%2}};"
        :: "r"(swizzled + (first + g + 8 * h) * {ROW}), "f"(z[4 * j + 2 * h] + bias.x),
           "f"(z[4 * j + 2 * h + 1] + bias.y) : "memory");
}}
__syncwarp();
wp::vec_t<{n_out}, real> result;
{results}__syncwarp();
return result;
""")


def products(plan: WidePlan, index: int, multiply: str) -> str:
    """Layer `index` under way."""
    layer = plan.layers[index]
    return f"""begin_products();
for (int b = 0; b < {layer.layout.k_pad // 16}; ++b)
    {multiply}, a[b], tile(weights + {layer.weights} + b / 4 * {layer.panel} + 32 * (b % 4), 0u), b);
commit();
"""


def forward_layer(spec: NetworkSpec, plan: WidePlan, index: int) -> str:
    values = "d[4 * j + 2 * h] + bias.x", "d[4 * j + 2 * h + 1] + bias.y"
    if spec.activation is relu:
        word = "pack_relu({}, {})"
    else:
        word = "pack({}, {})" if spec.activation is linear else "pack(hidden({}), hidden({}))"
    keep = ""
    if index + 1 > plan.low and spec.activation is not linear:
        # of two positive halves the sign bits are set; those of a leaky ReLU are negative or not
        bits = "a[b][r] + 0x7fff7fffu" if spec.activation is relu else "~a[b][r]"
        keep = f"""unsigned mask[2] = {{0u, 0u}};
for (int b = 0; b < {BLOCKS}; ++b) for (int r = 0; r < 4; ++r)
    mask[b / 4] |= (({bits}) & 0x80008000u) >> (b % 4 * 4 + r);
asm volatile("st.shared.v2.b32 [%0],{{%1,%2}};" :: "r"(masks + {index * MASKS}), "r"(mask[0]), "r"(mask[1]) : "memory");
"""
    if index + 1 in plan.gradients:
        keep += f"for (int b = 0; b < {BLOCKS}; ++b) save(matrices({plan.h(index + 1)}, b), a[b]);\n"
    return f"""{{ real d[{WIDTH // 2}];
{products(plan, index, "multiply_hidden(d")}
{wait(0, "d")}
for (int j = 0; j < {WIDTH // 8}; ++j) {{
    const float2 bias = read_biases({index}, j);
    for (int h = 0; h < 2; ++h) a[j / 2][j % 2 * 2 + h] = {word.format(*values)};
}}
{keep}}}
"""


def upper_layers(spec: NetworkSpec, plan: WidePlan) -> str:
    """`(memory, sums, z, dy) -> sums`: dz of all layers from `low` on, dW of `high` if it is not `low`. All threads."""
    layers = "".join(backward_layer(spec, plan, index) for index in reversed(range(plan.low + 1, len(plan.layers))))
    gradients = "".join(weight_multiply(spec, plan, index) for index in plan.gradients if index > plan.low)
    count = len(plan.layers)
    bias_sums = plan.first_sum(count - 1) + plan.layers[-1].registers if plan.high == count - 1 else None
    return unrolled(f"""{enter(spec, plan)}{wgmma("multiply_back", spec, WIDTH, True, True)}{gradients}
auto sum = sums;
unsigned dz[1][{BLOCKS}][4];
real dh[{WIDTH // 2}];
{start(spec, plan.last_dz, 1, bias_sums)}
{layers}publish();
return sum;
""")


def back_products(plan: WidePlan, index: int) -> str:
    layer = plan.layers[index]
    return f"""begin_products();
for (int b = 0; b < {1 if layer.last else BLOCKS}; ++b)
    multiply_back(dh, dz[0][b], tile(weights + {layer.weights} + {16 * ROW} * b, {layer.panel}u), b);
commit();
"""


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
    due = index in plan.gradients
    gradient = (
        f"publish();\n__syncthreads();\nbegin_products();\n{weight_products(plan, index)}commit();\n" if due else ""
    )
    word = "pack(dh[8 * b + 2 * r], dh[8 * b + 2 * r + 1])"
    if spec.activation is relu:
        word += " & spread_signs(mask[b / 4] << (b % 4 * 4 + r))"
    elif spec.activation is leaky_relu:
        pair = ("15", "31")
        values = (
            f"dh[8 * b + 2 * r + {e}] * d_hidden(mask[b / 4] >> ({pair[e]} - (b % 4 * 4 + r)) & 1u ? 1.0f : -1.0f)"
            for e in range(2)
        )
        word = f"pack({', '.join(values)})"
    masks = (
        ""
        if spec.activation is linear
        else f"""asm volatile("ld.shared.v2.b32 {{%0,%1}},[%2];"
    : "=r"(mask[0]), "=r"(mask[1]) : "r"(masks + {(index - 1) * MASKS}) : "memory");
"""
    )
    save = ""
    if index - 1 in plan.gradients:
        save = f"for (int b = 0; b < {BLOCKS}; ++b) save(matrices({plan.dz(index - 1)}, b), dz[0][b]);\n"
    return f"""{back_products(plan, index)}{gradient}{{ unsigned mask[2];
{masks}{wait(1 if due else 0, "dh")}
for (int b = 0; b < {BLOCKS}; ++b) for (int r = 0; r < 4; ++r) dz[0][b][r] = {word};
}}
{wait(0, "sum.c") + "__syncthreads();" if due else ""}
{save}"""


def first_layer(spec: NetworkSpec, plan: WidePlan, input_gradient: bool) -> str:
    """`(memory, sums) -> sums`: dW of layer `low`; `input_gradient` (layer 0) leaves dx where x was. All threads."""
    k_pad = plan.layers[0].layout.k_pad
    before = after = lambdas = ""
    if input_gradient:
        lambdas = wgmma("multiply_back", spec, k_pad, True, True)
        before = f"""unsigned dz[1][{BLOCKS}][4];
real dh[{k_pad // 2}];
for (int b = 0; b < {BLOCKS}; ++b) load(matrices({plan.dz(0)}, b), dz[0][b]);
{back_products(plan, 0)}
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
        checked += [f"sums.c[{i}] * 0.0f" for i in [*range(sums, sums + layer.registers), *biases]]
        for h, i in enumerate(biases if not layer.last else ()):
            row = f"group * 64u + place / 32u * 16u + g + {8 * h}"
            text += f"if (t == 0u) put({layer.bias_first} + {row}, sums.c[{i}]);\n"
    checks = " + ".join(f"({' + '.join(checked[i::8] or ['0.0f'])})" for i in range(8))
    n_out = final.layout.n
    if plan.layers[plan.high].last:
        bias = f"sums.c[{plan.first_sum(plan.high) + final.registers}]"
        text += f"""__syncthreads();
if (lane / 2u < {n_out}u) total[lane / 2u * 16u + 2u * warp + lane % 2u] = {bias};
if (lane < 2u) total[{16 * n_out} + 2u * warp + lane] = all;
__syncthreads();
if (threadIdx.x <= {n_out}u) {{
    all = 0.0f;
    for (int i = 0; i < 16; ++i) all += total[threadIdx.x * 16u + i];
    put(threadIdx.x < {n_out}u ? {final.bias_first} + threadIdx.x : {plan.floats}u, all);
}}
"""
    return unrolled(f"""using real = wp::float32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u, warp = threadIdx.x >> 5;
const unsigned group = warp >> 2, place = threadIdx.x & 127u;
real* const total = reinterpret_cast<real*>(memory.data.ptr);
real* const mine = partial.data + static_cast<size_t>(blockIdx.x) * {plan.slice};
auto put = [&](unsigned i, real v) {{ mine[i] = add ? mine[i] + v : v; }};
real all = loss;
for (int bit = 16; bit > 1; bit /= 2) all += __shfl_xor_sync(0xffffffffu, all, bit);
if (!(loss * 0.0f + {checks} == 0.0f)) flags.data[parity] = 1;
{text}""")
