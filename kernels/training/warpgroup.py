"""How Hopper's warpgroups share a fused training step of 64 neurons a layer, and its CUDA text (`wgmma`, sm_90a).

Each of the two warpgroups of a block takes 128 samples through all layers by itself. Vectors stay in registers from
layer to layer, as `wgmma` leaves results the way it takes its first operand. What the weights' gradient needs, every
layer's input H and dz, the gradient to its pre-activations, also lies in shared memory, in the layout that both ends of
`wgmma` read: rows of 64 16-bit elements, one a sample, whose 16-byte units are swizzled by the row's low three bits
(PTX ISA, "matrix descriptor", 128-byte swizzle). dW = dz^T H is kept in registers for as long as the launch lasts. A
column of ones beside H gives the biases' gradient in the same product. dz of a layer takes the place of its results.

Names as in `kernels.training.cuda`; a tile `m` is 64 samples, of which each warp has 16 rows.
"""

from dataclasses import dataclass

from kernels.activations import leaky_relu, linear, relu
from kernels.coopvec import primitives
from kernels.coopvec.fragments import unrolled
from kernels.coopvec.layout import LayerLayout, bias_is_half, network_layout
from kernels.coopvec.primitives import MMA_TYPES
from kernels.coopvec.spec import BFLOAT16, FLOAT16, NetworkSpec, round_up

WIDTH = 64  # neurons of every hidden layer
SAMPLES = 128  # of a warpgroup and round, one a thread
ROW = 128  # bytes
SLOT = SAMPLES * ROW  # bytes of 128 samples' vectors
GROUPS = 2  # warpgroups of a block
STEPS = SAMPLES // 16  # of a product over samples
MOST_SUMS = 132  # registers for sums, of the 255 a thread can have
MAX_OUT = 16


@dataclass(frozen=True)
class WarpgroupLayer:
    """weights: where in shared memory, in bytes. sums: the first of its registers. first: of its floats in a block's
    gradient. columns: of the product that gives the gradient, the biases' ones after the inputs."""

    layout: LayerLayout
    last: bool
    weights: int
    sums: int
    first: int

    @property
    def columns(self) -> int:
        return self.layout.n_pad if self.last else self.layout.k_pad + 8

    @property
    def registers(self) -> int:
        """Of a thread, for the weights' gradient."""
        return (self.layout.n_pad if self.last else self.layout.k_pad) // 2

    @property
    def bias_sums(self) -> int:
        return self.sums + self.registers

    @property
    def bias_first(self) -> int:
        return self.first + self.registers * SAMPLES


@dataclass(frozen=True)
class WarpgroupPlan:
    """Offsets in bytes from the first multiple of 1024 in shared memory: all weights, biases as float32, ones, then
    each warpgroup's area: a slot for each layer's input, one for the last layer's results and dz."""

    layers: tuple[WarpgroupLayer, ...]
    biases: int
    sums: int
    floats: int

    @property
    def ones(self) -> int:
        return self.areas + GROUPS * self.area

    @property
    def areas(self) -> int:
        return round_up(self.biases + 4 * WIDTH * len(self.layers), 1024)

    @property
    def area(self) -> int:
        return (len(self.layers) + 1) * SLOT

    @property
    def words(self) -> int:
        return (1024 + self.ones + 16 * ROW) // 4

    @property
    def threads(self) -> int:
        return GROUPS * SAMPLES

    @property
    def slice(self) -> int:
        return self.floats + 4


def make_warpgroup_plan(spec: NetworkSpec) -> WarpgroupPlan | None:
    """None for a network that this way does not train."""
    hidden, activations = spec.sizes[1:-1], (relu, leaky_relu, linear)
    fits = spec.format in (FLOAT16, BFLOAT16) and spec.activation in activations and hidden and set(hidden) == {WIDTH}
    if not fits or spec.sizes[0] > WIDTH or spec.sizes[-1] > MAX_OUT:
        return None
    weights, sums, first, layers = 0, 0, 0, []
    layouts, _ = network_layout(spec, True)
    for index, layout in enumerate(layouts):
        layer = WarpgroupLayer(layout, index == len(layouts) - 1, weights, sums, first)
        weights += round_up(layout.n_pad, 16) * ROW
        sums = layer.bias_sums + (layout.n if layer.last else 4)
        first = layer.bias_first + layout.n_pad
        layers.append(layer)
    return WarpgroupPlan(tuple(layers), weights, sums, first) if sums <= MOST_SUMS else None


def wgmma(name: str, spec: NetworkSpec, n: int, registers: bool, transposed: bool) -> str:
    """A lambda `name(d, a, b, keep)`: d = a b, plus d if `keep`; d is 64 x n. registers: a is four of them, else a
    descriptor of a transposed matrix. transposed: b lies with the inner dimension outside."""
    count, element = n // 2, MMA_TYPES[spec.format][1]
    results = ",".join(f"%{i}" for i in range(count))
    outputs = ", ".join(f'"+f"(d[{i}])' for i in range(count))
    if registers:
        kind, a, i = "const unsigned (&a)[4]", '"r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3])', count + 4
        operand, turns = "{" + ",".join(f"%{count + r}" for r in range(4)) + "}", f"{transposed:d}"
    else:
        kind, a, i, operand, turns = "Tile a", '"l"(a)', count + 1, f"%{count}", f"1, {transposed:d}"
    return f"""auto {name} = [](real (&d)[{count}], {kind}, Tile b, int keep) {{
asm volatile("{{.reg .pred p; setp.ne.b32 p, %{i + 1}, 0;\\n"
    "wgmma.mma_async.sync.aligned.m64n{n}k16.f32.{element}.{element} {{{results}}}, {operand}, %{i}, p, 1, 1, {turns};}}"
    : {outputs} : {a}, "l"(b), "r"(keep) : "memory"); }};
"""


def enter(spec: NetworkSpec, plan: WarpgroupPlan) -> str:
    slopes = "".join(
        f"auto d_{name} = [](real z) -> real {{ return {activation.derivative}; }};\n"
        for name, activation in (("hidden", spec.activation), ("last", spec.output_activation))
    )
    return f"""{primitives.prelude(spec)}{slopes}{MEMORY}
const unsigned warp = __shfl_sync(0xffffffffu, threadIdx.x >> 5, 0), group = warp >> 2;
const unsigned weights = (static_cast<unsigned>(__cvta_generic_to_shared(memory.data.ptr)) + 1023u) & ~1023u;
const unsigned biases = weights + {plan.biases}, ones = weights + {plan.ones};
const unsigned area = weights + {plan.areas} + group * {plan.area};
const unsigned first = (warp & 3u) * 16;  // row of this warp in a tile
const unsigned own = ((lane >> 4) * 64 + first + (lane & 15u)) * {ROW};  // this lane's own sample
const unsigned row = (first + (lane & 15u)) * {ROW} + (((lane >> 4) ^ (lane & 7u)) << 4);
auto unit = [&](unsigned slot, int u) {{ return slot + own + ((u ^ (lane & 7u)) << 4); }};
auto matrices = [&](unsigned slot, int m, int b) {{ return slot + m * {64 * ROW} + (row ^ (b << 5)); }};
auto bias_pair = [&](int layer, int j) {{ float2 v;  // of neurons 8 j + 2 t and the next
    asm volatile("ld.shared.v2.f32 {{%0,%1}},[%2];" : "=f"(v.x), "=f"(v.y)
        : "r"(biases + {4 * WIDTH} * layer + 32 * j + 8 * t));
    return v; }};
auto together = [&]() {{ asm volatile("bar.sync %0, {SAMPLES};" :: "r"(group + 1u) : "memory"); }};
"""


MEMORY = """
typedef unsigned long long Tile;
auto load = [](unsigned address, unsigned (&w)[4]) {
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
auto save = [](unsigned address, const unsigned (&w)[4]) {
    asm volatile("stmatrix.sync.aligned.m8n8.x4.shared.b16 [%0],{%1,%2,%3,%4};"
        :: "r"(address), "r"(w[0]), "r"(w[1]), "r"(w[2]), "r"(w[3]) : "memory");
};
auto save_unit = [](unsigned address, unsigned x, unsigned y, unsigned z, unsigned w) {
    asm volatile("st.shared.v4.b32 [%0],{%1,%2,%3,%4};" :: "r"(address), "r"(x), "r"(y), "r"(z), "r"(w) : "memory");
};
auto load_unit = [](unsigned address, unsigned (&w)[4]) {
    asm volatile("ld.shared.v4.b32 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
auto spread_signs = [](unsigned v) { unsigned r;  // of each half over all its bits
    asm("prmt.b32 %0,%1,0,0xbb99;" : "=r"(r) : "r"(v)); return r; };
// descriptor: a swizzle of 128 bytes, 1024 bytes from 8 rows to the next 8, `beyond` from 64 columns to the next
auto tile = [](unsigned address, unsigned beyond) {
    return static_cast<Tile>(address >> 4 | beyond >> 4 << 16) | static_cast<Tile>(64u | 1u << 30) << 32;
};
auto begin_products = []() { asm volatile("wgmma.fence.sync.aligned;" ::: "memory"); };
auto commit = []() { asm volatile("wgmma.commit_group.sync.aligned;" ::: "memory"); };
auto publish = []() { asm volatile("fence.proxy.async.shared::cta;" ::: "memory"); };  // what was stored, to wgmma
"""


def wait(pending: int, *registers: str) -> str:
    """Until at most so many groups of products are under way; `registers`: arrays that are then ready."""
    text = f'asm volatile("wgmma.wait_group.sync.aligned {pending};" ::: "memory");\n'
    for name in registers:
        text += f'for (int r = 0; r < sizeof({name}) / 4; ++r) asm volatile("" : "+f"({name}[r]) :: "memory");\n'
    return text


def begin(spec: NetworkSpec, plan: WarpgroupPlan) -> str:
    """`(params, memory)`: stage weights, biases and ones. All threads."""
    _, words = network_layout(spec, True)
    text = ""
    for index, layer in enumerate(plan.layers):
        layout = layer.layout
        pairs = layout.k_pairs(spec.format)
        text += f"""for (unsigned i = threadIdx.x; i < {layout.n_pad // 8 * pairs * 32}u; i += {plan.threads}u) {{
    const uint4 v = __ldg(reinterpret_cast<const uint4*>(mine + {layout.weights}) + i);
    const unsigned p = i / 32u % {pairs}u, n = i / {32 * pairs}u * 8u + g, swizzle = 4u * p ^ g;
    char* const place = shared + {layer.weights} + n * {ROW} + 4u * t;
    const unsigned words[4] = {{v.x, v.y, v.z, v.w}};
    for (int part = 0; part < 4; ++part)
        *reinterpret_cast<unsigned*>(place + ((swizzle ^ part) << 4)) = words[part];
}}
if (threadIdx.x < {layout.n_pad}u) {{
    const unsigned n = threadIdx.x;
    reinterpret_cast<real*>(shared + {plan.biases})[{WIDTH * index} + n] = {bias_value(spec, layout)};
}}
"""
        if layout.n_pad % 16:
            text += f"""if (threadIdx.x < 64u)
    reinterpret_cast<uint4*>(shared + {layer.weights + layout.n_pad * ROW})[threadIdx.x] = make_uint4(0u, 0u, 0u, 0u);
"""
    one = "0x3c003c00u" if spec.format is FLOAT16 else "0x3f803f80u"
    return unrolled(f"""{primitives.prelude(spec)}
const unsigned* const mine = params.packed.data + static_cast<size_t>(params.network) * {words};
char* const unaligned = reinterpret_cast<char*>(memory.data.ptr);
char* const shared = unaligned + (-static_cast<unsigned>(__cvta_generic_to_shared(unaligned)) & 1023u);
{text}
if (threadIdx.x < 128u) reinterpret_cast<uint4*>(shared + {plan.ones})[threadIdx.x] = make_uint4({one}, {one}, {one}, {one});
asm volatile("fence.proxy.async.shared::cta;" ::: "memory");
__syncthreads();
""")


def bias_value(spec: NetworkSpec, layout: LayerLayout) -> str:
    """Of neuron n, from the packed buffer."""
    if bias_is_half(spec, True):
        word = f"mine[{layout.bias} + n / 32u * 16u + n % 8u / 2u * 4u + n / 8u % 4u]"
        return f"n % 2u ? half_high({word}) : half_low({word})"
    return f"__uint_as_float(mine[{layout.bias} + n / 16u * 16u + n % 8u / 2u * 4u + n / 8u % 2u * 2u + n % 2u])"


def forward(spec: NetworkSpec, plan: WarpgroupPlan, halves: bool) -> str:
    """`(params, memory, x) -> z`, the last layer's pre-activations; keeps each layer's input. halves: x is of float16."""
    n_in, n_out, k_pad = spec.sizes[0], spec.sizes[-1], plan.layers[0].layout.k_pad
    final, slot = plan.layers[-1].layout, (len(plan.layers)) * SLOT
    text = ""
    for u in range(k_pad // 8):
        words = ", ".join(input_word(n_in, 8 * u + 2 * t, halves and spec.format is FLOAT16) for t in range(4))
        text += f"save_unit(unit(area, {u}), {words});\n"
    if k_pad < WIDTH:
        one = "0x3c003c00u" if spec.format is FLOAT16 else "0x3f803f80u"
        text += f"save_unit(unit(area, {k_pad // 8}), {one}, {one}, {one}, {one});\n"
    layers = "".join(forward_layer(spec, plan, index) for index in range(len(plan.layers) - 1))
    units = range(-(-n_out // 4))
    read = "".join(
        f"{{ unsigned v[4]; load_unit(unit(area + {slot}, {u}), v);\n"
        + "".join(f"result.c[{n}] = __uint_as_float(v[{n % 4}]);\n" for n in range(4 * u, min(4 * u + 4, n_out)))
        + "}\n"
        for u in units
    )
    return unrolled(f"""{enter(spec, plan)}
{wgmma("multiply_hidden", spec, WIDTH, True, False)}{wgmma("multiply_last", spec, final.n_pad, True, False)}
{text}__syncwarp();
unsigned a[2][4][4];
for (int m = 0; m < 2; ++m) for (int b = 0; b < {k_pad // 16}; ++b) load(matrices(area, m, b), a[m][b]);
{layers}
{{ real d[2][{final.n_pad // 2}];
{products(plan.layers[-1], "multiply_last")}
for (int m = 0; m < 2; ++m) {{
if (m == 0) {{ {wait(1, "d[0]")} }} else {{ {wait(0, "d[1]")} }}
for (int j = 0; j < {final.n_pad // 8}; ++j) {{
    const float2 bias = bias_pair({len(plan.layers) - 1}, j);
    for (int h = 0; h < 2; ++h) asm volatile("st.shared.v2.f32 [%0],{{%1,%2}};"
        :: "r"(area + {slot} + m * {64 * ROW} + (first + g + 8 * h) * {ROW} + (((2 * j + (t >> 1)) ^ g) << 4) + (t & 1u) * 8),
           "f"(d[m][4 * j + 2 * h] + bias.x), "f"(d[m][4 * j + 2 * h + 1] + bias.y) : "memory");
}} }} }}
__syncwarp();
wp::vec_t<{n_out}, real> result;
{read}return result;
""")


def input_word(n_in: int, k: int, halves: bool) -> str:
    if halves:
        low, high = (f"static_cast<unsigned>(x.c[{i}].u)" if i < n_in else "0u" for i in (k, k + 1))
        return f"{low} | {high} << 16"
    low, high = (f"static_cast<real>(x.c[{i}])" if i < n_in else "0.0f" for i in (k, k + 1))
    return f"pack({low}, {high})"


def products(layer: WarpgroupLayer, multiply: str) -> str:
    """`d[m] = a[m] W^T` for both tiles, under way, each a group."""
    return f"""begin_products();
for (int m = 0; m < 2; ++m) {{
    for (int b = 0; b < {layer.layout.k_pad // 16}; ++b)
        {multiply}(d[m], a[m][b], tile(weights + {layer.weights} + 32 * b, 0), b);
    commit();
}}
"""


def forward_layer(spec: NetworkSpec, plan: WarpgroupPlan, index: int) -> str:
    values = "d[m][4 * j + 2 * h] + bias.x, d[m][4 * j + 2 * h + 1] + bias.y"
    if spec.activation is relu:
        word = f"pack_relu({values})"
    elif spec.activation is linear:
        word = f"pack({values})"
    else:
        word = "pack({}, {})".format(*(f"hidden({value})" for value in values.split(", ")))
    return f"""{{ real d[2][32];
{products(plan.layers[index], "multiply_hidden")}
for (int m = 0; m < 2; ++m) {{
if (m == 0) {{ {wait(1, "d[0]")} }} else {{ {wait(0, "d[1]")} }}
for (int j = 0; j < 8; ++j) {{
    const float2 bias = bias_pair({index}, j);
    for (int h = 0; h < 2; ++h) a[m][j / 2][j % 2 * 2 + h] = {word};
}}
for (int b = 0; b < 4; ++b) save(matrices(area + {(index + 1) * SLOT}, m, b), a[m][b]);
}} }}
"""


def upper_layers(spec: NetworkSpec, plan: WarpgroupPlan) -> str:
    """`(memory, sums, z, dy) -> sums`: all layers but the first; dy is of the activated results. All threads."""
    final, n_out = plan.layers[-1], spec.sizes[-1]
    slot = len(plan.layers) * SLOT
    start = "".join(
        f"const real dz_{n} = dy.c[{n}] * d_last(z.c[{n}]); sum.c[{final.bias_sums + n}] += dz_{n};\n"
        for n in range(n_out)
    )
    for u in range(2):
        pairs = [[f"dz_{n}" if n < n_out else "0.0f" for n in (8 * u + 2 * t, 8 * u + 2 * t + 1)] for t in range(4)]
        start += f"save_unit(unit(area + {slot}, {u}), {', '.join(f'pack({low}, {high})' for low, high in pairs)});\n"
    layers = "".join(backward_layer(spec, plan, index) for index in reversed(range(1, len(plan.layers))))
    return unrolled(f"""{enter(spec, plan)}{wgmma("multiply_back", spec, WIDTH, True, True)}{weight_products(spec, plan)}
auto sum = sums;
unsigned dz[2][4][4];
{start}__syncwarp();
for (int m = 0; m < 2; ++m) load(matrices(area + {slot}, m, 0), dz[m][0]);
publish();
together();
{layers}return sum;
""")


def weight_products(spec: NetworkSpec, plan: WarpgroupPlan) -> str:
    sizes = sorted({layer.columns for layer in plan.layers})
    return "".join(wgmma(f"multiply_{n}", spec, n, False, True) for n in sizes)


def weight_gradient(plan: WarpgroupPlan, index: int) -> str:
    """Products of dz and H of layer `index`, under way, as one group; of the last layer H^T dz, of others dz^T H."""
    layer = plan.layers[index]
    h, dz = index * SLOT, (index + 1) * SLOT
    a, b = (h, dz) if layer.last else (dz, h)
    beyond = "0u" if layer.last else f"ones - (area + {b} + {16 * ROW} * s)"
    return f"""{{ real (&dw)[{layer.columns // 2}] = *reinterpret_cast<real (*)[{layer.columns // 2}]>(sum.c + {layer.sums});
for (int s = 0; s < {STEPS}; ++s)
    multiply_{layer.columns}(dw, tile(area + {a} + {16 * ROW} * s, 0u), tile(area + {b} + {16 * ROW} * s, {beyond}), 1);
commit();
"""


def backward_layer(spec: NetworkSpec, plan: WarpgroupPlan, index: int) -> str:
    """dz, of this warp's rows in registers and of the warpgroup in shared memory, to that of the layer before."""
    layer, h = plan.layers[index], index * SLOT
    blocks = 1 if layer.last else 4
    word = "pack(dh[m][8 * b + 2 * r], dh[m][8 * b + 2 * r + 1])"  # register r: columns of tile 2 b + r / 2, half r % 2
    kept = f"unsigned kept[4]; load(matrices(area + {h}, m, b), kept);"
    if spec.activation is relu:
        word = f"{word} & spread_signs(kept[r] + 0x7fff7fffu)"
    elif spec.activation is leaky_relu:
        values = (f"dh[m][8 * b + 2 * r + {e}] * d_hidden({side}(kept[r]))" for e, side in enumerate(("low", "high")))
        word = "pack({}, {})".format(*values)
    else:
        kept = ""
    return f"""{{ real dh[2][32];
begin_products();
for (int m = 0; m < 2; ++m) {{
    for (int b = 0; b < {blocks}; ++b) multiply_back(dh[m], dz[m][b], tile(weights + {layer.weights} + {16 * ROW} * b, 0u), b);
    commit();
}}
{weight_gradient(plan, index)}
for (int m = 0; m < 2; ++m) {{
if (m == 0) {{ {wait(2, "dh[0]")} }} else {{ {wait(1, "dh[1]")} }}
for (int b = 0; b < 4; ++b) {{ {kept}
    for (int r = 0; r < 4; ++r) dz[m][b][r] = {word};
}} }}
{wait(0, "dw")}}}
together();
for (int m = 0; m < 2; ++m) for (int b = 0; b < 4; ++b) save(matrices(area + {h}, m, b), dz[m][b]);
publish();
together();
}}
"""


def first_layer(spec: NetworkSpec, plan: WarpgroupPlan, input_gradient: bool) -> str:
    """`(memory, sums) -> sums`: the first layer; `input_gradient` leaves dx where x was. All threads."""
    layer = plan.layers[0]
    k_pad, n_blocks = layer.layout.k_pad, 4
    before = after = lambdas = ""
    if input_gradient:
        lambdas = wgmma("multiply_back", spec, k_pad, True, True)
        before = f"""unsigned dz[2][{n_blocks}][4];
real dx[2][{k_pad // 2}];
for (int m = 0; m < 2; ++m) for (int b = 0; b < {n_blocks}; ++b) load(matrices(area + {SLOT}, m, b), dz[m][b]);
begin_products();
for (int m = 0; m < 2; ++m)
    for (int b = 0; b < {n_blocks}; ++b) multiply_back(dx[m], dz[m][b], tile(weights + {layer.weights} + {16 * ROW} * b, 0u), b);
commit();
"""
        after = f"""for (int m = 0; m < 2; ++m) for (int b = 0; b < {k_pad // 16}; ++b) {{
    unsigned w[4];
    for (int r = 0; r < 4; ++r) w[r] = pack(dx[m][8 * b + 2 * r], dx[m][8 * b + 2 * r + 1]);
    save(matrices(area, m, b), w);
}}
"""
    names = ("dx[0]", "dx[1]", "dw") if input_gradient else ("dw",)
    return unrolled(f"""{enter(spec, plan)}{lambdas}{wgmma(f"multiply_{layer.columns}", spec, layer.columns, False, True)}
auto sum = sums;
{before or "begin_products();"}
{weight_gradient(plan, 0)}{wait(0, *names)}}}
together();
{after}return sum;
""")


def input_gradient(spec: NetworkSpec, plan: WarpgroupPlan, c_type: str) -> str:
    """`(memory) -> dx` of this thread's sample, as `first_layer` left it."""
    n_in = spec.sizes[0]
    text = f"{enter(spec, plan)}wp::vec_t<{n_in}, {c_type}> dx;\n__syncwarp();\n"
    for u in range(-(-n_in // 8)):
        text += f"{{ unsigned v[4]; load_unit(unit(area, {u}), v);\n"
        for k in range(8 * u, min(8 * u + 8, n_in)):
            text += f"dx.c[{k}] = {c_type}({('low', 'high')[k % 2]}(v[{k % 8 // 2}]));\n"
        text += "}\n"
    return unrolled(text + "__syncwarp();\nreturn dx;\n")


def finish(plan: WarpgroupPlan, n_out: int) -> str:
    """As `cuda_finish.finish`: each warpgroup adds up half of the registers of both."""
    places = [
        (layer.sums + r, layer.first + SAMPLES * r) for layer in plan.layers for r in range(layer.registers)
    ]
    half = len(places) // 2
    checked = [sum for sum, _ in places] + list(range(plan.layers[-1].bias_sums, plan.sums))
    checked += [layer.bias_sums + r for layer in plan.layers[:-1] for r in (0, 2)]
    checks = " + ".join(f"sums.c[{i}] * 0.0f" for i in checked)
    base = len(places) * SAMPLES
    leave = add = ""
    for i, (sum, first) in enumerate(places):
        leave += f"if (group == {int(i < half)}u) total[{i * SAMPLES} + place] = sums.c[{sum}];\n"
        value = f"(add ? mine[{first} + place] : 0.0f) + (sums.c[{sum}] + total[{i * SAMPLES} + place])"
        add += f"if (group == {int(i >= half)}u) mine[{first} + place] = {value};\n"
    for layer in plan.layers[:-1]:
        for h in range(2):
            leave += f"""if (t == 0u) total[{base} + group * {WIDTH} + (place >> 5) * 16 + g + {8 * h}] =
    sums.c[{layer.bias_sums + 2 * h}];
"""
        value = f"(add ? mine[{layer.bias_first} + place] : 0.0f) + (total[{base} + place] + total[{base + WIDTH} + place])"
        add += f"if (threadIdx.x < {WIDTH}u) mine[{layer.bias_first} + place] = {value};\n"
        base += 2 * WIDTH
    leave += f"""const real biases[{n_out}] = {{{", ".join(f"sums.c[{plan.layers[-1].bias_sums + n}]" for n in range(n_out))}}};
for (int n = 0; n < {n_out}; ++n) {{ const real all = sum_of_warp(biases[n]); if (lane == 0) total[{base} + 8 * n + warp] = all; }}
{{ const real all = sum_of_warp(loss); if (lane == 0) total[{base + 8 * n_out} + warp] = all; }}
"""
    places = f"threadIdx.x < {n_out}u ? {plan.layers[-1].bias_first} + threadIdx.x : {plan.floats}"
    return unrolled(f"""using real = wp::float32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u, warp = threadIdx.x >> 5;
const unsigned group = warp >> 2, place = threadIdx.x & 127u;
real* const total = reinterpret_cast<real*>(memory.data.ptr);
real* const mine = partial.data + static_cast<size_t>(blockIdx.x) * {plan.slice};
auto sum_of_warp = [](real v) {{ for (int bit = 16; bit > 0; bit /= 2) v += __shfl_xor_sync(0xffffffffu, v, bit); return v; }};
if (!(loss * 0.0f + {checks} == 0.0f)) flags.data[parity] = 1;
__syncthreads();
{leave}__syncthreads();
{add}if (threadIdx.x < {n_out + 1}u) {{
    const unsigned i = {places};
    real all = add ? mine[i] : 0.0f;
    for (int w = 0; w < 8; ++w) all += total[{base} + 8 * threadIdx.x + w];
    mine[i] = all;
}}
""")
