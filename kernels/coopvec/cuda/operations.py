"""CUDA text of the single operations on tensor cores, for warps that arrive whole; see `operations_text`."""

import warp as wp

from warp_neural.kernels.coopvec.cuda import adjoint as cuda_adjoint
from warp_neural.kernels.coopvec.cuda import fragments, primitives
from warp_neural.kernels.coopvec.cuda import network as cuda
from warp_neural.kernels.coopvec.fragment_layout import Text, accumulators
from warp_neural.kernels.coopvec.layout import LayerLayout
from warp_neural.kernels.coopvec.product_types import PACKED, c_type
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.spec import C_TYPES, INT8, NetworkSpec, round_up

WORDS = {8: "unsigned char", 16: "unsigned short", 32: "unsigned"}  # C++ types of stored elements


def as_network(spec) -> tuple[NetworkSpec, LayerLayout]:
    """The product as a network of one layer, for the texts of `fragments`."""
    network = NetworkSpec(
        (spec.columns, spec.rows), activations.linear, activations.linear, spec.format, spec.accumulation,
        spec.result if spec.result in C_TYPES else wp.float32,
    )  # fmt: skip
    k_pad, n_pad = round_up(spec.columns, spec.format.k_step), round_up(spec.rows, 8)
    return network, LayerLayout(spec.columns, spec.rows, k_pad, n_pad, 0, 0, 0, 0)


def load_words(spec, layer: LayerLayout) -> str:
    """`q`: the weights of tile j, K blocks 2 p and 2 p + 1; 16 bytes at once where the layout is made for it."""
    format = spec.format
    pairs = layer.k_pairs(format)
    if spec.layout == "inferencing_optimal" and not spec.transpose:
        return f"const uint4 q = __ldg(reinterpret_cast<const uint4*>(base) + (j * {pairs} + p) * 32 + lane);"
    operands = layer.operands(format)
    (rows, columns), memory = operands.axes, operands.memory
    digits = memory.only("e", "upper").split(Text("e")) | memory.only("register", "half").split(Text("r"))
    row, column = rows.join(g=Text("g"), tile=Text("j")), columns.join(**digits, t=Text("t"), pair=Text("p"))
    return f"""unsigned words[4];
const auto* stored = reinterpret_cast<const {WORDS[format.bits]}*>(base);
UNROLL for (int r = 0; r < 4; ++r) {{
    words[r] = 0u;
    UNROLL for (int e = 0; e < {format.per_word}; ++e) {{
        const integer row = {row}, column = {column};
        if (row < {spec.rows} && column < {spec.columns})
            words[r] |= static_cast<unsigned>(stored[index(row, column)]) << {format.bits % 32} * e;
    }}
}}
const uint4 q = make_uint4(words[0], words[1], words[2], words[3]);"""


def read_vector(spec, network: NetworkSpec, layer: LayerLayout) -> str:
    """The thread's own vector as the A operand `a`."""
    if spec.dtype in C_TYPES:
        return fragments.read_input(network, layer, scaled=False)
    units = []
    for unit in range(layer.k_pad // 16):
        first = [16 * unit + 2 * lane for lane in range(4)]  # columns k, k + 1, k + 8, k + 9
        units.append([f"pair({k}) | pair({k + 8}) << 16" for k in first])
    if spec.dtype is PACKED:
        pair = f"k < {spec.columns} ? v.c[k / 4] >> 8 * (k % 4) & (k + 1 < {spec.columns} ? 0xffffu : 0xffu) : 0u"
    else:
        pair = f"(k < {spec.columns} ? element(k) : 0u) | (k + 1 < {spec.columns} ? element(k + 1) << 8 : 0u)"
    return f"auto pair = [&](int k) -> unsigned {{ return {pair}; }};\n{fragments.read_rows(units, 'a')}"


def tensor_product(spec, with_bias: bool) -> str:
    """The product for warps that arrive whole; several matrices in a warp are peeled as in `fragments`."""
    network, layer = as_network(spec)
    format, tiles = spec.format, layer.n_pad // 8
    kind, registers = primitives.accumulator(network)
    parts = 2 if primitives.packs_halves(network) else 4
    bias = [f"bias_at(2 * m + h, 8 * j + 2 * t + {e})" for e in (0, 1)]
    sums = [f"d[m][j][2 * h + {e}]" for e in (0, 1)]
    exact = spec.result is wp.int32
    floats_of_sums = format is INT8 and not exact  # see fragments.start_tile
    bits, value = ("unsigned", "integer") if exact else ("__float_as_uint", "__uint_as_float")
    if floats_of_sums or not with_bias:
        zero = "0x4b400000" if floats_of_sums else "0"
        start = f"UNROLL for (int r = 0; r < {registers}; ++r) d[m][j][r] = {zero};"
    elif spec.accumulation == "float16":
        start = f"UNROLL for (int h = 0; h < 2; ++h) d[m][j][h] = half_pack({bias[0]}, {bias[1]});"
    else:
        start = f"UNROLL for (int h = 0; h < 2; ++h) {{ {sums[0]} = {bias[0]}; {sums[1]} = {bias[1]}; }}"
    if floats_of_sums:
        add = [f" + {b}" if with_bias else "" for b in bias]
        sums = [f"__int_as_float({d}) - 12582912.0f{more}" for d, more in zip(sums, add, strict=True)]
    if spec.accumulation == "float16":
        result = "o[m][j][h] = d[m][j][h];"
    elif parts == 2:
        result = f"o[m][j][h] = half_pack({sums[0]}, {sums[1]});"
    else:
        result = f"o[m][j][h] = {bits}({sums[0]}); o[m][j][2 + h] = {bits}({sums[1]});"
    pointer = f"const wp::{spec.bias}*"
    rows = f"""{pointer} row_bias[4];
UNROLL for (int i = 0; i < 4; ++i) row_bias[i] = reinterpret_cast<{pointer}>(
    __shfl_sync(0xffffffffu, reinterpret_cast<unsigned long long>(biases), 8 * i + static_cast<integer>(g)));
auto bias_at = [&](integer i, integer n) {{ return n < {spec.rows} ? bias_value(row_bias[i], n) : 0; }};
"""
    blocks = layer.k_blocks(format)
    multiply = fragments.for_each_network(f"""UNROLL for (int j = 0; j < {tiles}; ++j)
UNROLL for (int p = 0; p < {layer.k_pairs(format)}; ++p) {{
{load_words(spec, layer)}
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int b = 0; b < 2; ++b) if (2 * p + b < {blocks}) {{
    unsigned mine[4];
    UNROLL for (int r = 0; r < 4; ++r) mine[r] = a[m][2 * p + b][r] & keep[2 * m + r % 2];
    multiply(d[m][j], d[m][j], mine, b ? q.z : q.x, b ? q.w : q.y);
}} }}
""")
    body = f"""{primitives.prelude(network)}{primitives.staging(network)}
const auto& x = v;
const unsigned long long key = reinterpret_cast<unsigned long long>(elements);
unsigned a[2][{blocks}][4], o[2][{tiles}][{parts}];
{read_vector(spec, network, layer)}
{rows if with_bias else ""}
{kind} d[2][{tiles}][{registers}];
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {tiles}; ++j) {{ {start} }}
{multiply}
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {tiles}; ++j)
UNROLL for (int h = 0; h < 2; ++h) {{ {result} }}
{cuda.write_output(network, layer, value)}
return y;
"""
    return cuda.when_whole_warp(network, body)


def tensor_outer_product(spec, gradient_dtype: type) -> str:
    """Both vectors as fragments with samples along K: transposed block by block; one addition to memory a warp."""
    network, _ = as_network(spec)
    n_blocks, k_blocks = round_up(spec.rows, 16) // 16, round_up(spec.columns, 16) // 16
    sums = accumulators(16 * n_blocks, 16 * k_blocks)
    digits = sums.memory.only("e", "upper").split(Text("r"))
    row = sums.axes[0].join(**digits, g=Text("g"), block=Text("nb"))
    column = sums.axes[1].join(**digits, t=Text("t"), tile=Text("(2 * kb + s)"))

    def units(vector: str, n: int) -> list[list[str]]:
        value = [f"static_cast<real>({vector}.c[{i}])" if i < n else "0.0f" for i in range(round_up(n, 16))]
        return [[f"pack({value[i]}, {value[i + 1]})" for i in range(u, u + 8, 2)] for u in range(0, len(value), 8)]

    half = gradient_dtype is wp.float16
    add = f"""UNROLL for (int r = 0; r < 4; ++r) {{
        const integer row = {row}, column = {column};
        if (row < {spec.rows} && column < {spec.columns}) add(target + index(row, column), dw[r]);
    }}"""
    add_half = f"""UNROLL for (int r = 0; r < 4; r += 2) {{
        const integer row = {row}, column = {column};
        if (row >= {spec.rows} || column >= {spec.columns}) continue;
        const integer place = index(row, column), next = index(row, column + 1);
        const bool pair = column + 1 < {spec.columns};
        if (pair && next == place + 1) add_half2(target + place, dw[r], dw[r + 1]);
        else {{ add_half(target + place, dw[r]); if (pair) add_half(target + next, dw[r + 1]); }}
    }}"""
    accumulate = f"""UNROLL for (int nb = 0; nb < {n_blocks}; ++nb) {{
unsigned left[2][4];
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int r = 0; r < 4; ++r)
    left[m][r] = transposed(fa[m][nb][r % 2 * 2 + r / 2] & keep[2 * m + r / 2]);
UNROLL for (int kb = 0; kb < {k_blocks}; ++kb) UNROLL for (int s = 0; s < 2; ++s) {{
    real dw[4] = {{0.0f, 0.0f, 0.0f, 0.0f}};
    UNROLL for (int m = 0; m < 2; ++m) multiply_add(dw, dw, left[m], right[m][kb][2 * s], right[m][kb][2 * s + 1]);
    {add_half if half else add}
}} }}
"""
    kind = c_type(gradient_dtype)
    peel = fragments.for_each_network(
        f"{kind}* target = const_cast<{kind}*>(reinterpret_cast<const {kind}*>(base));\n{accumulate}"
    )
    body = f"""{primitives.prelude(network)}{primitives.staging(network)}{cuda_adjoint.prelude(network)}
const unsigned long long key = reinterpret_cast<unsigned long long>(base_gradient);
unsigned fa[2][{n_blocks}][4], fb[2][{k_blocks}][4], right[2][{k_blocks}][4];
{fragments.read_rows(units("a", spec.rows), "fa")}
{fragments.read_rows(units("b", spec.columns), "fb")}
{cuda_adjoint.for_each_word(k_blocks, "right[m][b][r] = transposed(fb[m][b][r]);")}
{peel}
return;
"""
    return cuda.when_whole_warp(network, body)
