"""CUDA text of the pieces of a network on tensor cores: load, deal to fragments, multiply, peel networks, deal back.

Samples are rows of `mma.sync` (32 a warp, two tiles of 16), neurons its columns. In PTX's fragments, lane = 4 g + t.
The accumulators of one layer are, lane by lane, the A operand of the next, so that vectors stay in registers from first
to last layer. They enter and leave through shared memory (`ldmatrix`, `stmatrix`), a few 16-byte units of each row at a
time, swizzled so that no two lanes meet in a bank.

Names in the text: `m` sample tile, `h` upper or lower half of a tile, `i = 2 m + h` (row 8 i + g is lane 8 i + g),
`j` tile of 8 neurons, `b` K block, `q` a 16-byte load of weights.
"""

from dataclasses import replace

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.cuda.primitives import accumulator, prelude, staging
from warp_neural.kernels.coopvec.layout import MAGIC, LayerLayout, bias_is_half, network_layout
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import FLOAT16, INT8, TF32, NetworkSpec

MAX_GROUP = 4  # tiles of neurons multiplied at a time: more hide latency, fewer need fewer registers


def read_rows(units: list[list[str]], target: str) -> str:
    """Deal each thread's own row, given as 16-byte units of 4 words, to A operands `target[m][b]`."""
    writes = "\n".join(
        f"if (u == {u}) own[{u} % UNITS ^ swizzle] = make_uint4({', '.join(words)});" for u, words in enumerate(units)
    )
    return f"""UNROLL for (int c = 0; c < {len(units)}; c += UNITS) {{
UNROLL for (int u = c; u < c + UNITS && u < {len(units)}; ++u) {{ {writes} }}
__syncwarp();
UNROLL for (int b = c / 2; b < (c + UNITS) / 2 && b < {len(units) // 2}; ++b)
UNROLL for (int m = 0; m < 2; ++m) gather(m, b, {target}[m][b]);
__syncwarp();
}}
"""


def write_rows(units: int, word: str, stores: list[str]) -> str:
    """Deal words back: `word` of unit u in row 8 i + g; `stores[u]` takes the thread's own unit `v`, a uint4."""
    reads = "\n".join(
        f"if (u == {u}) {{ const uint4 v = own[u % UNITS ^ swizzle]; {text} }}" for u, text in enumerate(stores)
    )
    return f"""UNROLL for (int c = 0; c < {units}; c += UNITS) {{
UNROLL for (int u = c; u < c + UNITS && u < {units}; ++u) {{
    unsigned w[4];
    UNROLL for (int i = 0; i < 4; ++i) w[i] = {word};
    scatter(u, w);
}}
__syncwarp();
UNROLL for (int u = c; u < c + UNITS && u < {units}; ++u) {{ {reads} }}
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
            values = [f"static_cast<real>(x.c[{k}])" if k < n_in else "0.0f" for k in ks]
            if format is INT8 and scaled:
                values = [f"input_byte({value})" for value in values]
            pack = "bytes_of" if format is INT8 and scaled else "pack"
            words.append(f"{pack}({', '.join(values)})" if ks[0] < n_in else "0u")
            if format is FLOAT16 and spec.dtype is wp.float16 and ks[-1] < n_in:
                words[-1] = f"x.c[{ks[0]}].u | static_cast<unsigned>(x.c[{ks[1]}].u) << 16"
        units.append(words)
    scale = f"""const real input_scale = __uint_as_float(__ldg(mine + {layer.scales})) * (1.0f / 254.0f);
auto input_byte = [&](real x) {{  // as a fraction of the range from -127 to 127 steps, where saturation is free
    return __float_as_uint(fmaf(__saturatef(fmaf(x, input_scale, 0.5f)), 254.0f, {MAGIC - 127}f)); }};
"""
    return (scale if format is INT8 and scaled else "") + read_rows(units, "a")


def bias_words(spec: NetworkSpec, layer: LayerLayout, j: str, pointer: str) -> str:
    """Statements that set `c`, one tile's accumulators of row half h, from the bias: `c[h]` or `c[2 h], c[2 h + 1]`."""
    half = bias_is_half(spec, cuda=True)
    text = f"const integer tile = {j};\n"
    text += f"const uint4 v = __ldg(reinterpret_cast<const uint4*>({pointer} + at + {layer.bias})"
    if half:
        pick = "tile % 4 == 0 ? v.x : tile % 4 == 1 ? v.y : tile % 4 == 2 ? v.z : v.w"
        return f"{text} + tile / 4 * 4 + t);\nc[h] = {pick};"
    return f"""{text} + tile / 2 * 4 + t);
c[2 * h] = __uint_as_float(tile % 2 ? v.z : v.x); c[2 * h + 1] = __uint_as_float(tile % 2 ? v.w : v.y);"""


def start_tile(spec: NetworkSpec, layer: LayerLayout) -> str:
    """Set one tile `c`, the value its accumulators start from: the bias of each row's own network."""
    if spec.format is INT8:
        return (
            "UNROLL for (int r = 0; r < 4; ++r) c[r] = 0x4b400000;"  # 1.5 * 2^23: read as a float, 12582912 + the sum
        )
    return f"UNROLL for (int h = 0; h < 2; ++h) {{ {bias_words(spec, layer, 'j0 + j', 'row[2 * m + h]')} }}"


def pre_activation(spec: NetworkSpec, layer: LayerLayout) -> str:
    """A lambda `z_value(m, j, h, e)`: one pre-activation as float32, neuron 8 (j0 + j) + 2 t + e of row (m, h)."""
    more = ""
    if spec.format is INT8:
        biases = bias_words(spec, replace(layer, bias=layer.fractions), "j0 + j", "row[2 * m + h]")
        more = f"""auto fraction_value = [&](int m, int j, int h, int e) -> real {{  // of the next layer's largest
real c[4], r;
{biases}
asm("fma.rn.sat.f32 %0,%1,%2,%3;" : "=f"(r) : "f"(__int_as_float(d[m][j][2 * h + e])),
    "f"(__uint_as_float(__ldg(row[2 * m + h] + at + {layer.scales + 3}))), "f"(c[2 * h + e]));
return r; }};
"""
        value = f"""
real c[4];
{bias_words(spec, layer, "j0 + j", "row[2 * m + h]")}
const real step = __uint_as_float(__ldg(row[2 * m + h] + at + {layer.scales + 1}));
return fmaf(__int_as_float(d[m][j][2 * h + e]) - 12582912.0f, step, c[2 * h + e]);"""
    elif spec.accumulation == "float16":
        value = "return e ? half_high(d[m][j][h]) : half_low(d[m][j][h]);"
    else:
        value = "return d[m][j][2 * h + e];"
    return f"{more}auto z_value = [&](int m, int j, int h, int e) -> real {{ {value} }};\n"


def load_weights(spec: NetworkSpec, layer: LayerLayout, group: int) -> str:
    """`q[j]`: K blocks 2 p and 2 p + 1 of tiles j0 .. j0 + group - 1 of the network at `base`."""
    return f"""uint4 q[{group}];
UNROLL for (int j = 0; j < {group}; ++j)
    q[j] = __ldg(reinterpret_cast<const uint4*>(base + at + {layer.weights})
        + ((j0 + j) * {layer.k_pairs(spec.format)} + p) * 32 + lane);
"""


def masked_products(spec: NetworkSpec, layer: LayerLayout, group: int) -> str:
    """`d[m][j]` for `group` tiles from `j0` on, network after network: rows of others are zeroed in the A operand, so
    that each row collects the product with its own matrix, all in the same accumulators."""
    kind, registers = accumulator(spec)
    return f"""UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {group}; ++j) {{
{kind} (&c)[{registers}] = d[m][j];
{start_tile(spec, layer)} }}
{prefetch(spec, layer, group)}""" + for_each_network(f"""
UNROLL for (int p = 0; p < {layer.k_pairs(spec.format)}; ++p) {{
{load_weights(spec, layer, group)}
UNROLL for (int m = 0; m < 2; ++m) if (use[m])
UNROLL for (int b = 0; b < 2; ++b) if (2 * p + b < {layer.k_blocks(spec.format)}) {{
    unsigned mine[4];
    UNROLL for (int r = 0; r < 4; ++r) mine[r] = a[m][2 * p + b][r] & keep[2 * m + r % 2];
    UNROLL for (int j = 0; j < {group}; ++j) multiply(d[m][j], d[m][j], mine, b ? q[j].z : q[j].x, b ? q[j].w : q[j].y);
}} }}
""")


def prefetch(spec: NetworkSpec, layer: LayerLayout, group: int) -> str:
    """Start loading the tiles' weights of all the warp's networks at once, each network's lanes sharing its lines."""
    pairs = layer.k_pairs(spec.format)
    return f"""for (unsigned line = rank; line < {4 * group * pairs}u; line += peers)
    asm volatile("prefetch.global.L1 [%0];" :: "l"(mine + at + {layer.weights} + j0 * {128 * pairs} + 32u * line));
"""


def for_each_network(body: str) -> str:
    """Peel the warp's distinct networks: `base` its parameters; `keep[i]` all ones where row i is its own; `use[m]`."""
    return f"""for (unsigned todo = 0xffffffffu; todo;) {{
const int leader = __ffs(todo) - 1;
const unsigned* base = reinterpret_cast<const unsigned*>(__shfl_sync(0xffffffffu, key, leader));
const unsigned same = __ballot_sync(0xffffffffu, key == reinterpret_cast<unsigned long long>(base));
todo &= ~same;
const bool use[2] = {{(same & 0xffffu) != 0u, same >> 16 != 0u}};
unsigned keep[4];
UNROLL for (int i = 0; i < 4; ++i) keep[i] = 0u - (same >> (8 * i + g) & 1u);
{body}}}
"""


def group_of(tiles: int) -> int:
    """The largest number of tiles, at most MAX_GROUP, that divides `tiles`."""
    return max(group for group in range(1, MAX_GROUP + 1) if tiles % group == 0)


def enter(spec: NetworkSpec) -> str:
    """The lambdas, and this thread's network: `mine` its parameters, `key` the same as a number."""
    _, words = network_layout(spec, True)
    return f"""{prelude(spec)}{staging(spec)}
const unsigned* mine = params.packed.data + static_cast<size_t>(params.network) * {words};
const unsigned long long key = reinterpret_cast<unsigned long long>(mine);
"""


ROWS = paste(NATIVE / "network_rows.cuh")
