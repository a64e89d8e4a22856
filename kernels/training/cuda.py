"""CUDA text of a fused training step: the whole block forward and back, weight gradients in registers.

Names as in `kernels.coopvec.fragments`: samples are rows (32 a warp, tiles `m`, halves `h`), neurons columns (tiles `j`,
K blocks `b`), lane = 4 g + t. Vectors pass through shared memory as 8 x 8 matrices of 128 contiguous bytes, each lane's
16 bytes beside its neighbours', so that no access meets a bank conflict: matrix r of block (m, b) holds the rows of half
r % 2 and the columns of half r / 2, register r of an A operand.

The functions share registers (`sums`, which the kernel passes along) and shared memory (`plan.Plan`).
"""

from kernels.activations import leaky_relu, linear, relu
from kernels.coopvec import cuda, primitives
from kernels.coopvec.fragments import group_of, pre_activation, start_tile, unrolled
from kernels.coopvec.layout import network_layout
from kernels.coopvec.spec import FLOAT16, NetworkSpec
from kernels.training.plan import LayerPlan, Plan

LIFTED = (relu, leaky_relu, linear)  # activations whose derivative at f(z) is that at z: f(z) is kept, else z


def enter(spec: NetworkSpec, plan: Plan) -> str:
    """Lambdas, and the addresses `weights` (of the block), `area` (of this warp) and `place` (of this lane in it)."""
    ones = "0x3c003c00u" if spec.format is FLOAT16 else "0x3f803f80u"
    slopes = "".join(
        f"auto d_{name} = [](real z) -> real {{ return {activation.derivative}; }};\n"
        for name, activation in (("hidden", spec.activation), ("last", spec.output_activation))
    )
    return f"""{primitives.prelude(spec)}{primitives.mma("multiply_add", spec.format, "real")}{slopes}{MEMORY}
const unsigned ones = {ones}, warp = threadIdx.x >> 5;
const unsigned weights = static_cast<unsigned>(__cvta_generic_to_shared(memory.data.ptr)) + lane * 16;
const unsigned areas = weights + {4 * plan.weights}, area = areas + warp * {4 * plan.area};
"""


MEMORY = """
auto load = [](unsigned address, unsigned (&w)[4]) {
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
auto load_transposed = [](unsigned address, unsigned (&w)[4]) {
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
auto save = [&](unsigned address, const unsigned (&w)[4]) {
#if __CUDA_ARCH__ >= 900
    asm volatile("stmatrix.sync.aligned.m8n8.x4.shared.b16 [%0],{%1,%2,%3,%4};"
        :: "r"(address), "r"(w[0]), "r"(w[1]), "r"(w[2]), "r"(w[3]) : "memory");
#else
    for (int r = 0; r < 4; ++r)
        asm volatile("st.shared.b32 [%0],%1;" :: "r"(address - lane * 12 + 128 * r), "r"(w[r]) : "memory");
#endif
};
auto save_unit = [](unsigned address, unsigned x, unsigned y, unsigned z, unsigned w) {
    asm volatile("st.shared.v4.b32 [%0],{%1,%2,%3,%4};" :: "r"(address), "r"(x), "r"(y), "r"(z), "r"(w) : "memory");
};
auto load_unit = [](unsigned address, unsigned (&w)[4]) {
    asm volatile("ld.shared.v4.b32 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
const unsigned turned = (lane >> 4) * 128 + (lane >> 3 & 1u) * 256 + (lane & 7u) * 16;  // matrices 0, 2, 1, 3
auto spread_signs = [](unsigned v) { unsigned r;  // of each half over all its bits
    asm("prmt.b32 %0,%1,0,0xbb99;" : "=r"(r) : "r"(v)); return r; };
// this lane's own row: unit u holds its columns 8 u .. 8 u + 7
auto own_unit = [&](unsigned slot, int blocks, int u) {
    return slot + (((lane >> 4) * blocks + u / 2) * 4 + u % 2 * 2 + (lane >> 3 & 1u)) * 128 + (lane & 7u) * 16 - lane * 16;
};
"""


def begin(spec: NetworkSpec, plan: Plan) -> str:
    """`(params, memory)`: stage the weights, 8 x 8 matrices in the order of the packed buffer. All threads."""
    _, words = network_layout(spec, True)
    copies = "".join(
        f"""for (int i = 0; i < {layer.layout.bias - layer.layout.weights}; i += {4 * plan.threads}) {{
    const unsigned word = i + 4 * threadIdx.x;
    if (word < {layer.layout.bias - layer.layout.weights}u) {{
        const uint4 v = __ldg(reinterpret_cast<const uint4*>(mine + {layer.layout.weights} + word));
        unsigned* const matrices = target + {layer.weights} + word / 128 * 128 + word % 128 / 4;
        matrices[0] = v.x; matrices[32] = v.y; matrices[64] = v.z; matrices[96] = v.w;
    }}
}}
"""
        for layer in plan.layers
    )
    return unrolled(f"""const unsigned* mine = params.packed.data + static_cast<size_t>(params.network) * {words};
unsigned* target = reinterpret_cast<unsigned*>(memory.data.ptr);
{copies}__syncthreads();
""")


def forward(spec: NetworkSpec, plan: Plan) -> str:
    """`(params, memory, x) -> z`, the last layer's pre-activations; keeps each layer's input in the warp's area."""
    n_in, n_out, blocks = spec.sizes[0], spec.sizes[-1], plan.layers[0].k_blocks
    _, words = network_layout(spec, True)
    units = []
    for u in range(2 * blocks):
        pairs = [(8 * u + 2 * t, 8 * u + 2 * t + 1) for t in range(4)]
        values = [[f"static_cast<real>(x.c[{k}])" if k < n_in else "0.0f" for k in pair] for pair in pairs]
        units.append([f"pack({low}, {high})" for low, high in values])
    body = f"""{enter(spec, plan)}
const unsigned* base = params.packed.data + static_cast<size_t>(params.network) * {words};
const unsigned* const row[4] = {{base, base, base, base}};
const unsigned at = 0u;
unsigned a[2][{max(layer.k_blocks for layer in plan.layers)}][4];
{"".join(f"save_unit(own_unit(area, {blocks}, {u}), {', '.join(unit)});" for u, unit in enumerate(units))}
__syncwarp();
for (int m = 0; m < 2; ++m) for (int b = 0; b < {blocks}; ++b) load(area + (m * {blocks} + b) * 512, a[m][b]);
{"".join(forward_layer(spec, plan, index) for index in range(len(plan.layers)))}
__syncwarp();
wp::vec_t<{n_out}, real> result;
{"".join(read_result(plan, n_out, j) for j in range(plan.layers[-1].layout.n_pad // 8))}
return result;
"""
    return unrolled(body)


def forward_layer(spec: NetworkSpec, plan: Plan, index: int) -> str:
    layer, is_last = plan.layers[index], index == len(plan.layers) - 1
    layout, tiles = layer.layout, layer.layout.n_pad // 8
    group, blocks = group_of(tiles), layer.k_blocks
    kind, registers = primitives.accumulator(spec)
    if is_last:
        address = f"area + {4 * plan.output} - lane * 8 + ((m * {tiles} + j0 + j) * 2 + h) * 256"
        finish = f"""asm volatile("st.shared.v2.f32 [%0],{{%1,%2}};"
    :: "r"({address}), "f"(z_value(m, j, h, 0)), "f"(z_value(m, j, h, 1)) : "memory");"""
        declare = copy = ""
    else:
        kept = "next" if spec.activation in LIFTED else "z"
        declare = f"unsigned next[2][{tiles // 2}][4]{'' if kept == 'next' else f', z[2][{tiles // 2}][4]'};"
        finish = cuda.to_next(spec, layout)
        if kept == "z":
            z = "d[m][j][h]" if spec.accumulation == "float16" else "pack(z_value(m, j, h, 0), z_value(m, j, h, 1))"
            finish += f" z[m][(j0 + j) / 2][(j0 + j) % 2 * 2 + h] = {z};"
        copy = f"""for (int m = 0; m < 2; ++m) for (int b = 0; b < {tiles // 2}; ++b) {{
    save(area + {4 * plan.layers[index + 1].h} + (m * {tiles // 2} + b) * 512, {kept}[m][b]);
    for (int r = 0; r < 4; ++r) a[m][b][r] = next[m][b][r];
}}"""
    return f"""{{ {declare}
for (int j0 = 0; j0 < {tiles}; j0 += {group}) {{
{kind} d[2][{group}][{registers}];
for (int m = 0; m < 2; ++m) for (int j = 0; j < {group}; ++j) {{
{kind} (&c)[{registers}] = d[m][j];
{start_tile(spec, layout)} }}
for (int p = 0; p < {layout.k_pairs(spec.format)}; ++p) {{
    unsigned w[{group}][4];
    for (int j = 0; j < {group}; ++j)
        load(weights + {4 * layer.weights} + ((j0 + j) * {layout.k_pairs(spec.format)} + p) * 512, w[j]);
    for (int b = 0; b < 2; ++b) if (2 * p + b < {blocks}) for (int j = 0; j < {group}; ++j)
    for (int m = 0; m < 2; ++m) multiply(d[m][j], d[m][j], a[m][2 * p + b], w[j][2 * b], w[j][2 * b + 1]);
}}
{pre_activation(spec, layout)}
for (int m = 0; m < 2; ++m) for (int j = 0; j < {group}; ++j) for (int h = 0; h < 2; ++h) {{ {finish} }}
}}
{copy} }}
"""


def read_result(plan: Plan, n_out: int, j: int) -> str:
    """Columns 8 j .. 8 j + 7 of this lane's own row of results."""
    tiles = plan.layers[-1].layout.n_pad // 8
    text = f"""{{ unsigned v[4];
const unsigned from = area - lane * 16 + {4 * plan.output}
    + (((lane >> 4) * {tiles} + {j}) * 2 + (lane >> 3 & 1u)) * 256 + (lane & 7u) * 32;
"""
    for half in range(2):
        columns = [(8 * j + 4 * half + i, i) for i in range(4) if 8 * j + 4 * half + i < n_out]
        if columns:
            text += f"load_unit(from + {16 * half}, v);\n"
            text += "".join(f"result.c[{n}] = __uint_as_float(v[{i}]);\n" for n, i in columns)
    return text + "}\n"


def backward(spec: NetworkSpec, plan: Plan, input_gradient: bool) -> str:
    """`(memory, sums, z, dy) -> sums`, dy of the activated results; with `input_gradient` leaves dx in the area.

    All threads of the block."""
    final, n_out = plan.layers[-1], spec.sizes[-1]
    units = []
    for u in range(2 * final.n_blocks):
        pairs = [(8 * u + 2 * t, 8 * u + 2 * t + 1) for t in range(4)]
        values = [[f"dy.c[{n}] * d_last(z.c[{n}])" if n < n_out else "0.0f" for n in pair] for pair in pairs]
        units.append([f"pack({low}, {high})" for low, high in values])
    slot, blocks = f"area + {4 * final.dz}", final.n_blocks
    layers = "".join(backward_layer(spec, plan, i, i > 0 or input_gradient) for i in reversed(range(len(plan.layers))))
    body = f"""{enter(spec, plan)}
auto sum = sums;
{"".join(f"save_unit(own_unit({slot}, {blocks}, {u}), {', '.join(unit)});" for u, unit in enumerate(units))}
{layers}
{plan.barrier}
return sum;
"""
    return unrolled(body)


def backward_layer(spec: NetworkSpec, plan: Plan, index: int, go_on: bool) -> str:
    """Layer `index`, whose dz, of the whole block, lies in the areas after the barrier."""
    layer = plan.layers[index]
    text = input_products(spec, plan, index) if go_on else ""
    return f"{plan.barrier}\n{{\n{text}{weight_products(spec, plan, layer, index)}}}\n"


def input_products(spec: NetworkSpec, plan: Plan, index: int) -> str:
    """dh = dz W, times the slope of the layer before: that layer's dz, saved."""
    layer = plan.layers[index]
    pairs, tiles, blocks = layer.layout.k_pairs(spec.format), layer.layout.n_pad // 8, layer.k_blocks
    target = 4 * (plan.layers[index - 1].dz if index else plan.dx)
    word = "pack(dh[m][2 * b + r / 2][r % 2 * 2], dh[m][2 * b + r / 2][r % 2 * 2 + 1])"
    if index == 0 or spec.activation is linear:
        word, kept = f"previous[r] = {word};", ""
    else:
        kept = f"unsigned kept[4]; load(area + {4 * layer.h} + (m * {blocks} + 2 * p + b) * 512, kept);"
        if spec.activation is relu:  # a positive half is not zero: then the sum's sign bit is set
            word = f"{word} & spread_signs(kept[r] + 0x7fff7fffu)"
        else:
            low, high = (
                f"dh[m][2 * b + r / 2][r % 2 * 2 + {e}] * d_hidden({side}(kept[r]))"
                for e, side in enumerate(("low", "high"))
            )
            word = f"pack({low}, {high})"
        word = f"previous[r] = {word};"
    second = f"2 * nb + 1 < {tiles}"
    return f"""unsigned dz[2][{layer.n_blocks}][4];
for (int m = 0; m < 2; ++m) for (int b = 0; b < {layer.n_blocks}; ++b)
    load(area + {4 * layer.dz} + (m * {layer.n_blocks} + b) * 512, dz[m][b]);
for (int p = 0; p < {pairs}; ++p) {{
real dh[2][4][4];
for (int m = 0; m < 2; ++m) for (int j = 0; j < 4; ++j) for (int r = 0; r < 4; ++r) dh[m][j][r] = 0.0f;
for (int nb = 0; nb < {layer.n_blocks}; ++nb) {{
    unsigned w0[4], w1[4] = {{0u, 0u, 0u, 0u}};
    load_transposed(weights + {4 * layer.weights} + (2 * nb * {pairs} + p) * 512, w0);
    if ({second}) load_transposed(weights + {4 * layer.weights} + ((2 * nb + 1) * {pairs} + p) * 512, w1);
    for (int j = 0; j < 4; ++j) if (2 * p + j / 2 < {blocks})
    for (int m = 0; m < 2; ++m) multiply_add(dh[m][j], dh[m][j], dz[m][nb], w0[j], w1[j]);
}}
for (int m = 0; m < 2; ++m) for (int b = 0; b < 2; ++b) if (2 * p + b < {blocks}) {{
    unsigned previous[4];
    {kept}
    for (int r = 0; r < 4; ++r) {{ {word} }}
    save(area + {target} + (m * {blocks} + 2 * p + b) * 512, previous);
}}
}}
"""


def weight_products(spec: NetworkSpec, plan: Plan, layer: LayerPlan, index: int) -> str:
    """Add this warp's units of dZ^T H over its part of the block's samples to `sum`, loading one step ahead.

    Warps of different columns start at different samples, so that each adds the biases of another share of them.
    """
    rows, columns, groups = layer.rows, layer.columns, layer.column_groups
    samples = plan.warps // layer.parts
    shared_bias = samples % groups == 0
    restore = ""
    if index > 0 and spec.activation not in LIFTED:
        restore = (
            "for (int r = 0; r < 4; ++r) h[now][c][r] = pack(hidden(low(h[now][c][r])), hidden(high(h[now][c][r])));"
        )
    bias = f"sum.c + {layer.sums} + {rows * columns * 8}"
    return f"""{"" if layer.tasks * layer.parts == plan.warps else f"if (warp < {layer.tasks * layer.parts}u)"} {{
const unsigned task = warp % {layer.tasks}u, part = warp / {layer.tasks}u, turn = task % {groups}u;
const unsigned one = {"ones" if shared_bias else "turn == 0 ? ones : 0u"};
const unsigned dz = areas + {4 * layer.dz} + task / {groups}u * {rows * 512} - lane * 16 + turned;
const unsigned from = areas + {4 * layer.h} + turn * {columns * 512};
unsigned d[2][{rows}][4], h[2][{columns}][4];
auto fetch = [&](int i, unsigned (&d)[{rows}][4], unsigned (&h)[{columns}][4]) {{
    const unsigned s = (part * {samples} + (i / 2 + turn) % {samples}) * {4 * plan.area}, m = i % 2;
    for (int row = 0; row < {rows}; ++row) load_transposed(dz + s + (m * {layer.n_blocks} + row) * 512, d[row]);
    for (int c = 0; c < {columns}; ++c) load_transposed(from + s + (m * {layer.k_blocks} + c) * 512, h[c]);
}};
fetch(0, d[0], h[0]);
for (int i = 0; i < {2 * samples}; ++i) {{
    const int now = i % 2;
    if (i + 1 < {2 * samples}) fetch(i + 1, d[1 - now], h[1 - now]);
    for (int c = 0; c < {columns}; ++c) {{
        {restore}
        for (int row = 0; row < {rows}; ++row) for (int side = 0; side < 2; ++side) {{
            real (&dw)[4] = *reinterpret_cast<real (*)[4]>(sum.c + {layer.sums} + ((row * {columns} + c) * 2 + side) * 4);
            multiply_add(dw, dw, d[now][row], h[now][c][2 * side], h[now][c][2 * side + 1]);
        }}
    }}
    if ({f"i / 2 % {groups} == 0" if shared_bias else "true"}) for (int row = 0; row < {rows}; ++row) {{
        real (&db)[4] = *reinterpret_cast<real (*)[4]>({bias} + row * 4);
        multiply_add(db, db, d[now][row], one, one);
    }}
}} }}
"""


def input_gradient(spec: NetworkSpec, plan: Plan) -> str:
    """`(memory) -> dx` of this thread, as `backward` left it."""
    n_in, blocks = spec.sizes[0], plan.layers[0].k_blocks
    text = f"{enter(spec, plan)}wp::vec_t<{n_in}, real> dx;\n"
    for u in range(-(-n_in // 8)):
        text += f"{{ unsigned v[4]; load_unit(own_unit(area + {4 * plan.dx}, {blocks}, {u}), v);\n"
        for k in range(8 * u, min(8 * u + 8, n_in)):
            text += f"dx.c[{k}] = {('low', 'high')[k % 2]}(v[{k % 8 // 2}]);\n"
        text += "}\n"
    return unrolled(text + "return dx;\n")


def finish(spec: NetworkSpec, plan: Plan) -> str:
    """`(memory, sums, loss, partial, flags, parity, add) -> None`: the block's sum of gradients and of losses to
    `partial[block, :]`, in one order on every run; `flags[parity] = 1` if one is not finite. All threads."""
    checks = " + ".join(f"sums.c[{i}] * 0.0f" for i in range(plan.sums))
    body = f"""using real = wp::float32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u, warp = threadIdx.x >> 5;
real* const total = reinterpret_cast<real*>(memory.data.ptr);
real* const mine = partial.data + static_cast<size_t>(blockIdx.x) * {plan.slice};
real all = loss;
for (int bit = 16; bit > 0; bit /= 2) all += __shfl_xor_sync(0xffffffffu, all, bit);
if (!(loss * 0.0f + {checks} == 0.0f)) flags.data[parity] = 1;
__syncthreads();
if (lane == 0) total[{plan.copies}] = all;
{"".join(leave_sums(layer) for layer in plan.layers)}
__syncthreads();
{"".join(gather_sums(plan, layer) for layer in plan.layers)}
if (threadIdx.x == 0) {{
    all = add ? mine[{plan.floats}] : 0.0f;
    for (int w = 0; w < {plan.warps}; ++w) all += total[{plan.copies} + w];
    mine[{plan.floats}] = all;
}}
"""
    return unrolled(body.replace(f"total[{plan.copies}] = all", f"total[{plan.copies} + warp] = all"))


def leave_sums(layer: LayerPlan) -> str:
    """To shared memory: a copy of the weights' gradients for each part, one of the biases' for each column group too."""
    rows, columns, groups = layer.rows, layer.columns, layer.column_groups
    return f"""if (warp < {layer.tasks * layer.parts}u) {{
const unsigned task = warp % {layer.tasks}u, part = warp / {layer.tasks}u;
const unsigned n0 = task / {groups}u * {rows}, b0 = task % {groups}u * {columns};
for (int i = 0; i < {rows}; ++i) for (int c = 0; c < {columns}; ++c) for (int side = 0; side < 2; ++side) {{
    const real* const dw = sums.c + {layer.sums} + ((i * {columns} + c) * 2 + side) * 4;
    const unsigned tile = ((n0 + i) * {layer.k_blocks} + b0 + c) * 2 + side;
    reinterpret_cast<float4*>(total + {layer.copies} + part * {layer.weight_floats} + tile * 128)[lane]
        = make_float4(dw[0], dw[1], dw[2], dw[3]);
}}
if (t == 0) for (int i = 0; i < {rows}; ++i) for (int half = 0; half < 2; ++half)
    total[{layer.bias_copies} + ((part * {groups} + task % {groups}u) * {layer.n_blocks} + n0 + i) * 16 + half * 8 + g]
        = sums.c[{layer.sums + rows * columns * 8} + i * 4 + 2 * half];
}}
"""


def gather_sums(plan: Plan, layer: LayerPlan) -> str:
    text = ""
    for first, size, copies, count in (
        (layer.first, layer.weight_floats, layer.copies, layer.parts),
        (layer.bias_first, layer.n_blocks * 16, layer.bias_copies, layer.parts * layer.column_groups),
    ):
        text += f"""for (unsigned i = threadIdx.x; i < {size}u; i += {plan.threads}u) {{
    real sum = add ? mine[{first} + i] : 0.0f;
    for (int copy = 0; copy < {count}; ++copy) sum += total[{copies} + copy * {size} + i];
    mine[{first} + i] = sum;
}}
"""
    return text
