"""CUDA text of the pieces of a network on tensor cores: load, deal to fragments, multiply, peel networks, deal back.

Samples are the rows of `mma.sync` (32 a warp, two tiles of 16), neurons its columns. In PTX's fragments, lane = 4 g + t;
the accumulators of one layer are, lane by lane, the A operand of the next, so that vectors stay in registers from the
first layer to the last. They enter and leave through shared memory (`ldmatrix`, `stmatrix`), a few 16-byte units of each
row at a time, swizzled so that no two lanes meet in a bank.

Names in the text: `m` sample tile, `h` upper or lower half of a tile, `i = 2 m + h` (row 8 i + g is lane 8 i + g's sample),
`j` tile of 8 neurons, `b` K block, `q` a 16-byte load of weights.
"""

import warp as wp

from kernels.coopvec.layout import LayerLayout, bias_is_half, network_layout
from kernels.coopvec.spec import BFLOAT16, E4M3, E5M2, FLOAT16, INT8, TF32, Format, NetworkSpec

MMA_TYPES = {
    FLOAT16: ("m16n8k16", "f16"),
    BFLOAT16: ("m16n8k16", "bf16"),
    TF32: ("m16n8k8", "tf32"),
    E4M3: ("m16n8k32", "e4m3"),
    E5M2: ("m16n8k32", "e5m2"),
    INT8: ("m16n8k32", "s8"),
}

MAX_GROUP = 4  # tiles of neurons multiplied at a time: more hide latency, fewer need fewer registers


def accumulator(spec: NetworkSpec) -> tuple[str, int]:
    """C++ type and count of one tile's accumulator registers."""
    if spec.format is INT8:
        return "integer", 4
    return ("unsigned", 2) if spec.accumulation == "float16" else ("real", 4)


def stage(spec: NetworkSpec) -> str:
    """The shared memory that vectors pass through; needs the lanes of `prelude`."""
    return STAGE.replace("ROW_UNITS", str(row_units(spec)))


def row_units(spec: NetworkSpec) -> int:
    """16-byte units of the longer of input and output row, rounded up to a power of two."""
    layers, _ = network_layout(spec, True)
    output_bits = 16 if packs_halves(spec) else 32
    units = max(layers[0].k_pad * spec.format.bits, layers[-1].n_pad * output_bits) // 128
    return 1 << (units - 1).bit_length()


def mma(name: str, format: Format, accumulator_type: str) -> str:
    """A lambda `name(d, c, a, b0, b1)`: d = c + a b on one 16 x 8 tile."""
    shape, element = MMA_TYPES[format]
    result, count, constraint = {"unsigned": ("f16", 2, "r"), "real": ("f32", 4, "f"), "integer": ("s32", 4, "r")}[
        accumulator_type
    ]

    def operands(first, number):
        return "{" + ",".join(f"%{i}" for i in range(first, first + number)) + "}"

    outputs = ", ".join(f'"={constraint}"(d[{i}])' for i in range(count))
    inputs = ", ".join([f'"r"(a[{i}])' for i in range(4)] + ['"r"(b0)', '"r"(b1)'])
    inputs += "".join(f', "{constraint}"(c[{i}])' for i in range(count))
    types = f"{accumulator_type} (&d)[{count}], const {accumulator_type} (&c)[{count}]"
    return f"""auto {name} = []({types}, const unsigned (&a)[4], unsigned b0, unsigned b1) {{
asm("mma.sync.aligned.{shape}.row.col.{result}.{element}.{element}.{result} "
    "{operands(0, count)},{operands(count, 4)},{operands(count + 4, 2)},{operands(count + 6, count)};"
    : {outputs} : {inputs}); }};
"""


LANES = """using real = wp::float32; using integer = wp::int32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u;
"""
STAGE = """
constexpr int CHUNK = WP_TILE_BLOCK_DIM <= 64 ? 8 : WP_TILE_BLOCK_DIM <= 128 ? 4 : 2;
constexpr int UNITS = ROW_UNITS < CHUNK ? ROW_UNITS : CHUNK;  // 16-byte units of a row staged at a time
__shared__ uint4 stage[WP_TILE_BLOCK_DIM * UNITS];
uint4* const own = stage + threadIdx.x * UNITS;
auto swizzled = [](unsigned row) { return UNITS == 8 ? row & 7u : UNITS == 4 ? row >> 1 & 3u : row >> 2 & 1u; };
const unsigned swizzle = swizzled(lane);
const unsigned rows = static_cast<unsigned>(__cvta_generic_to_shared(stage + (threadIdx.x & ~31u) * UNITS));
auto scatter = [&](int unit, unsigned (&w)[4]) {  // word t of `unit` of rows 8 i + g, to the rows' own lanes
#if __CUDA_ARCH__ >= 900
    const unsigned address = rows + (lane * UNITS + (unit % UNITS ^ swizzle)) * 16;
    asm volatile("stmatrix.sync.aligned.m8n8.x4.shared.b16 [%0],{%1,%2,%3,%4};"
        :: "r"(address), "r"(w[0]), "r"(w[1]), "r"(w[2]), "r"(w[3]) : "memory");
#else
    for (int i = 0; i < 4; ++i) {
        const unsigned row = 8 * i + g;
        uint4* place = own + (row - lane) * UNITS + (unit % UNITS ^ swizzled(row));
        reinterpret_cast<unsigned*>(place)[t] = w[i];
    }
#endif
};
auto gather = [&](int m, int b, unsigned (&w)[4]) {  // K block b of tile m as its A operand
    const unsigned row = 16 * m + (lane & 15u), unit = (2 * b + (lane >> 4)) % UNITS;
    const unsigned address = rows + (row * UNITS + (unit ^ swizzled(row))) * 16;
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
"""

# lambdas to and from registers of each format
HALF_TEXT = """
auto half_pack = [](real low, real high) { unsigned r;
    asm("cvt.rn.f16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low)); return r; };
auto half_low = [](unsigned v) { real r;
    asm("{.reg .f16 l,h; mov.b32 {l,h},%1; cvt.f32.f16 %0,l;}" : "=f"(r) : "r"(v)); return r; };
auto half_high = [](unsigned v) { real r;
    asm("{.reg .f16 l,h; mov.b32 {l,h},%1; cvt.f32.f16 %0,h;}" : "=f"(r) : "r"(v)); return r; };
auto half_max = [](unsigned a, unsigned b) { unsigned r;
    asm("max.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(b)); return r; };
auto half_min = [](unsigned a, unsigned b) { unsigned r;
    asm("min.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(b)); return r; };
auto half_leak = [&](unsigned a) { unsigned r;
    asm("mul.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(0x211f211fu)); return half_max(a, r); };  // 0.01
"""
PACK = {
    FLOAT16: """
auto pack = half_pack; auto low = half_low; auto high = half_high;
auto pack_relu = [](real low, real high) { unsigned r;
    asm("cvt.rn.relu.f16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low)); return r; };
""",
    BFLOAT16: """
auto low = [](unsigned v) { return __uint_as_float(v << 16); };
auto high = [](unsigned v) { return __uint_as_float(v & 0xffff0000u); };
auto pack = [](real low, real high) { unsigned r;
    asm("cvt.rn.bf16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low)); return r; };
auto pack_relu = [](real low, real high) { unsigned r;
    asm("cvt.rn.relu.bf16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low)); return r; };
""",
    TF32: """
auto pack = [](real x) { unsigned r; asm("cvt.rna.tf32.f32 %0,%1;" : "=r"(r) : "f"(x)); return r; };
""",
    # adding 1.5 * 2^23 rounds to an integer and leaves it in the low bits
    INT8: """
auto byte_of = [](real x) { return __float_as_uint(x + 12582912.0f); };
auto bytes_of = [](unsigned a, unsigned b, unsigned c, unsigned d) {
    return __byte_perm(__byte_perm(a, b, 0x0040), __byte_perm(c, d, 0x0040), 0x5410); };
auto clamped = [&](real x) { return byte_of(fminf(fmaxf(x, -127.0f), 127.0f)); };
auto pack = [&](real a, real b, real c, real d) { return bytes_of(clamped(a), clamped(b), clamped(c), clamped(d)); };
auto share = [&](real x) { return __float_as_uint(fmaf(__saturatef(x), 127.0f, 12582912.0f)); };
auto pack_share = [&](real a, real b, real c, real d) { return bytes_of(share(a), share(b), share(c), share(d)); };
""",
}
for fp8, pair in ((E4M3, "e4m3x2"), (E5M2, "e5m2x2")):
    PACK[fp8] = f"""
auto pack = [](real a, real b, real c, real d) {{ unsigned short u, v;
    asm("cvt.rn.satfinite.{pair}.f32 %0,%1,%2;" : "=h"(u) : "f"(b), "f"(a));
    asm("cvt.rn.satfinite.{pair}.f32 %0,%1,%2;" : "=h"(v) : "f"(d), "f"(c));
    return static_cast<unsigned>(u) | static_cast<unsigned>(v) << 16; }};
"""
# ReLU of float16 accumulators, faster than `cvt`: times 2^-8 a half's exponent field is that of e4m3; ties round up
PACK[E4M3] += """
auto relu_byte = [](unsigned v) { unsigned r;
    asm("fma.rn.relu.f16x2 %0,%1,%2,%3; min.f16x2 %0,%0,%4;"
        : "=&r"(r) : "r"(v), "r"(0x1c001c00u), "r"(0u), "r"(0x3f003f00u)); return r + r + 0x00800080u; };
auto pack_relu = [&](unsigned a, unsigned b) { return __byte_perm(relu_byte(a), relu_byte(b), 0x7531); };
"""
PACK[E5M2] += """
auto relu_byte = [&](unsigned v) { return half_min(half_max(v, 0u), 0x7b007b00u) + 0x00800080u; };
auto pack_relu = [&](unsigned a, unsigned b) { return __byte_perm(relu_byte(a), relu_byte(b), 0x7531); };
"""


def prelude(spec: NetworkSpec) -> str:
    """The lambdas that the rest of the text is made of."""
    text = LANES + HALF_TEXT + PACK[spec.format]
    text += mma("multiply", spec.format, accumulator(spec)[0])
    for name, activation in (("hidden", spec.activation), ("last", spec.output_activation)):
        text += f"auto {name} = [](real z) -> real {{ return {activation.value}; }};\n"
    return text


def packs_halves(spec: NetworkSpec) -> bool:
    """Whether results leave as pairs of float16."""
    return spec.accumulation == "float16" or spec.dtype is wp.float16


def read_rows(units: list[list[str]], target: str) -> str:
    """Deal each thread's own row, given as 16-byte units of 4 words, to A operands `target[m][b]`."""
    writes = "\n".join(
        f"if (u == {u}) own[{u} % UNITS ^ swizzle] = make_uint4({', '.join(words)});" for u, words in enumerate(units)
    )
    return f"""for (int c = 0; c < {len(units)}; c += UNITS) {{
for (int u = c; u < c + UNITS && u < {len(units)}; ++u) {{ {writes} }}
__syncwarp();
for (int b = c / 2; b < (c + UNITS) / 2 && b < {len(units) // 2}; ++b)
for (int m = 0; m < 2; ++m) gather(m, b, {target}[m][b]);
__syncwarp();
}}
"""


def write_rows(units: int, word: str, stores: list[str]) -> str:
    """Deal words back: `word` is that of unit u in row 8 i + g; `stores[u]` takes the thread's own unit `v` (a uint4)."""
    reads = "\n".join(
        f"if (u == {u}) {{ const uint4 v = own[u % UNITS ^ swizzle]; {text} }}" for u, text in enumerate(stores)
    )
    return f"""for (int c = 0; c < {units}; c += UNITS) {{
for (int u = c; u < c + UNITS && u < {units}; ++u) {{
    unsigned w[4];
    for (int i = 0; i < 4; ++i) w[i] = {word};
    scatter(u, w);
}}
__syncwarp();
for (int u = c; u < c + UNITS && u < {units}; ++u) {{ {reads} }}
__syncwarp();
}}
"""


def read_input(spec: NetworkSpec, layer: LayerLayout, scaled: bool = True) -> str:
    """The thread's own vector, converted, as the first layer's A operand `a`."""
    format, n_in = spec.format, spec.sizes[0]
    units = []
    for unit in range(layer.k_pad * format.bits // 128):
        words = []
        for lane in range(4):
            if format is TF32:
                ks = [unit // 2 * 8 + 2 * lane + unit % 2]
            else:
                first = unit * (16 if format.bits == 8 else 8) + 2 * lane
                ks = [first + offset for offset in (0, 1, 8, 9)[: format.per_word]]
            scale = " * input_scale" if format is INT8 and scaled else ""
            values = [f"static_cast<real>(x.c[{k}]){scale}" if k < n_in else "0.0f" for k in ks]
            words.append(f"pack({', '.join(values)})" if ks[0] < n_in else "0u")
            if format is FLOAT16 and spec.dtype is wp.float16 and ks[-1] < n_in:
                words[-1] = f"x.c[{ks[0]}].u | static_cast<unsigned>(x.c[{ks[1]}].u) << 16"
        units.append(words)
    scale = f"const real input_scale = __uint_as_float(__ldg(mine + {layer.scales}));\n"
    return (scale if format is INT8 and scaled else "") + read_rows(units, "a")


def bias_words(spec: NetworkSpec, layer: LayerLayout, j: str, pointer: str) -> str:
    """Statements that set `c`, one tile's accumulators of row half h, from the bias: `c[h]` or `c[2 h], c[2 h + 1]`."""
    half = bias_is_half(spec, cuda=True)
    text = f"const integer tile = {j};\nconst uint4 v = __ldg(reinterpret_cast<const uint4*>({pointer} + at + {layer.bias})"
    if half:
        return f"{text} + tile / 4 * 4 + t);\nc[h] = tile % 4 == 0 ? v.x : tile % 4 == 1 ? v.y : tile % 4 == 2 ? v.z : v.w;"
    return f"""{text} + tile / 2 * 4 + t);
c[2 * h] = __uint_as_float(tile % 2 ? v.z : v.x); c[2 * h + 1] = __uint_as_float(tile % 2 ? v.w : v.y);"""


def start_tile(spec: NetworkSpec, layer: LayerLayout) -> str:
    """Set one tile `c`, the value its accumulators start from: the bias of each row's own network."""
    if spec.format is INT8:
        return "for (int r = 0; r < 4; ++r) c[r] = 0x4b400000;"  # 1.5 * 2^23: read as a float, 12582912 + the sum
    return f"for (int h = 0; h < 2; ++h) {{ {bias_words(spec, layer, 'j0 + j', 'row[2 * m + h]')} }}"


def pre_activation(spec: NetworkSpec, layer: LayerLayout) -> str:
    """A lambda `z_value(m, j, h, e)`: one pre-activation as float32, neuron 8 (j0 + j) + 2 t + e of row (m, h)."""
    if spec.format is INT8:
        value = f"""
real c[4];
{bias_words(spec, layer, "j0 + j", "row[2 * m + h]")}
const real step = __uint_as_float(__ldg(row[2 * m + h] + at + {layer.scales + 1}));
return fmaf(__int_as_float(d[m][j][2 * h + e]) - 12582912.0f, step, c[2 * h + e]);"""
    elif spec.accumulation == "float16":
        value = "return e ? half_high(d[m][j][h]) : half_low(d[m][j][h]);"
    else:
        value = "return d[m][j][2 * h + e];"
    return f"auto z_value = [&](int m, int j, int h, int e) -> real {{ {value} }};\n"


def load_weights(spec: NetworkSpec, layer: LayerLayout, group: int) -> str:
    """`q[j]`: K blocks 2 p and 2 p + 1 of tiles j0 .. j0 + group - 1 of the network at `base`."""
    return f"""uint4 q[{group}];
for (int j = 0; j < {group}; ++j)
    q[j] = __ldg(reinterpret_cast<const uint4*>(base + at + {layer.weights}) + ((j0 + j) * {layer.k_pairs(spec.format)} + p) * 32 + lane);
"""


def masked_products(spec: NetworkSpec, layer: LayerLayout, group: int) -> str:
    """The same, network after network: rows of other networks are zeroed in the A operand, so that every row collects
    the product with its own matrix in the same accumulators, and loads do not wait for products."""
    kind, registers = accumulator(spec)
    return f"""for (int m = 0; m < 2; ++m) for (int j = 0; j < {group}; ++j) {{
{kind} (&c)[{registers}] = d[m][j];
{start_tile(spec, layer)} }}
{prefetch(spec, layer, group)}""" + for_each_network(f"""for (int p = 0; p < {layer.k_pairs(spec.format)}; ++p) {{
{load_weights(spec, layer, group)}
for (int m = 0; m < 2; ++m) if (use[m])
for (int b = 0; b < 2; ++b) if (2 * p + b < {layer.k_blocks(spec.format)}) {{
    unsigned mine[4];
    for (int r = 0; r < 4; ++r) mine[r] = a[m][2 * p + b][r] & keep[2 * m + r % 2];
    for (int j = 0; j < {group}; ++j) multiply(d[m][j], d[m][j], mine, b ? q[j].z : q[j].x, b ? q[j].w : q[j].y);
}} }}
""")


def prefetch(spec: NetworkSpec, layer: LayerLayout, group: int) -> str:
    """Start loading the tiles' weights of all the warp's networks at once, each network's lanes sharing its lines."""
    pairs = layer.k_pairs(spec.format)
    return f"""for (unsigned line = rank; line < {4 * group * pairs}u; line += peers)
    asm volatile("prefetch.global.L1 [%0];" :: "l"(mine + at + {layer.weights} + j0 * {128 * pairs} + 32u * line));
"""


def for_each_network(body: str) -> str:
    """Peel the warp's distinct networks: `base` its parameters, `keep[i]` all ones where row i belongs to it, `use[m]`."""
    return f"""for (unsigned todo = 0xffffffffu; todo;) {{
const int leader = __ffs(todo) - 1;
const unsigned* base = reinterpret_cast<const unsigned*>(__shfl_sync(0xffffffffu, key, leader));
const unsigned same = __ballot_sync(0xffffffffu, key == reinterpret_cast<unsigned long long>(base));
todo &= ~same;
const bool use[2] = {{(same & 0xffffu) != 0u, same >> 16 != 0u}};
unsigned keep[4];
for (int i = 0; i < 4; ++i) keep[i] = 0u - (same >> (8 * i + g) & 1u);
{body}}}
"""


def group_of(tiles: int, most: int) -> int:
    return max(group for group in range(1, most + 1) if tiles % group == 0)


def enter(spec: NetworkSpec) -> str:
    """The lambdas, and this thread's network: `mine` its parameters, `key` the same as a number."""
    _, words = network_layout(spec, True)
    return f"""{prelude(spec)}{stage(spec)}
const unsigned* mine = params.packed.data + static_cast<size_t>(params.network) * {words};
const unsigned long long key = reinterpret_cast<unsigned long long>(mine);
"""


ROWS = """const unsigned alike = __match_any_sync(0xffffffffu, key);  // lanes with this lane's network
const unsigned peers = __popc(alike), rank = __popc(alike & ((1u << lane) - 1u));
const unsigned* row[4];
for (int i = 0; i < 4; ++i)
    row[i] = reinterpret_cast<const unsigned*>(__shfl_sync(0xffffffffu, key, 8 * i + static_cast<int>(g)));
"""


def unrolled(text: str) -> str:
    return text.replace("for (int ", "\n#pragma unroll\nfor (int ")
