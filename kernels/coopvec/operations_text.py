"""C++ text of the four operations: one portable per-thread form, and the tensor cores where a whole warp arrives."""

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.convert import layout_text
from warp_neural.kernels.coopvec.cuda import adjoint as cuda_adjoint
from warp_neural.kernels.coopvec.cuda import fragments, primitives
from warp_neural.kernels.coopvec.cuda import network as cuda
from warp_neural.kernels.coopvec.formats import DECODE, ENCODE
from warp_neural.kernels.coopvec.fragment_layout import Text, accumulators
from warp_neural.kernels.coopvec.layout import LayerLayout
from warp_neural.kernels.native import ATOMICS, paste
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.spec import BFLOAT16, C_TYPES, FLOAT16, INT8, NetworkSpec, round_up

WORDS = {8: "unsigned char", 16: "unsigned short", 32: "unsigned"}


def accessors(spec, stride: str = "matrix_stride") -> str:
    """Lambdas for the per-thread form: `index(n, k)` of the matrix as it multiplies, decode, encode, round_value."""
    format = spec.format
    rows, columns = (spec.columns, spec.rows) if spec.transpose else (spec.rows, spec.columns)
    stored = "const integer n = column, k = row;" if spec.transpose else "const integer n = row, k = column;"
    elements = f"({stride} / {format.bits // 8})" if stride == "matrix_stride" else stride
    layout = layout_text(spec.layout, format, str(rows), str(columns), elements)
    return f"""using real = wp::float32; using integer = wp::int32;
auto decode = [](unsigned b) -> real {{ {DECODE[format]} }};
auto encode = [](real x) -> unsigned {{ {ENCODE[format]} }};
auto round_value = [&](real x) {{ return decode(encode(x)); }};
auto round_half = [](real x) {{ return wp::half_to_float(wp::float_to_half(x)); }};
auto index = [&](integer row, integer column) -> integer {{
    {stored} return {layout.index(Text("n"), Text("k"))}; }};
"""


def weights_and_bias(spec, with_bias: bool) -> str:
    """Lambdas `bits(n, k)` and `bias_value(n)`."""
    word = WORDS[spec.format.bits]
    text = f"""const auto* elements = reinterpret_cast<const {word}*>(
    reinterpret_cast<const char*>(matrix.data.data) + matrix_offset);
auto bits = [&](integer n, integer k) -> unsigned {{ return elements[index(n, k)]; }};
"""
    if with_bias:
        kind = C_TYPES[wp.float16 if spec.bias == "float16" else wp.float32]
        text += f"""const auto* biases = reinterpret_cast<const {kind}*>(
    reinterpret_cast<const char*>(bias.data.data) + bias_offset);
auto bias_value = [&](const {kind}* b, integer n) -> real {{ return static_cast<real>(b[n]); }};
"""
    return text


def product_text(spec, with_bias: bool) -> str:
    """Body of `matmul` and `matmul_add`."""
    step = spec.format.k_step
    half = spec.accumulation == "float16"
    start = "bias_value(biases, n)" if with_bias else "0.0f"
    rounding = f"if ((k + 1) % {max(step, 1)} == 0 || k + 1 == {spec.columns}) sum = round_half(sum);" if half else ""
    fast = tensor_product(spec, with_bias) if step else ""
    result = "round_half(sum)" if half else "sum"
    return f"""{accessors(spec)}{weights_and_bias(spec, with_bias)}
wp::vec_t<{spec.rows}, {C_TYPES[spec.dtype]}> y;
#if defined(__CUDA_ARCH__)
{fast}
#endif
real x[{spec.columns}];
for (integer k = 0; k < {spec.columns}; ++k) x[k] = round_value(static_cast<real>(v.c[k]));
for (integer n = 0; n < {spec.rows}; ++n) {{
    real sum = {f"round_half({start})" if half else start};
    for (integer k = 0; k < {spec.columns}; ++k) {{ sum += x[k] * decode(bits(n, k)); {rounding} }}
    y.c[n] = {result};
}}
return y;
"""


def product_adjoint_text(spec, with_bias: bool) -> str:
    """Per thread: gradients of the vector, and atomically of matrix and bias where they have a gradient array."""
    bias = """if (bias.gradient.data)
    for (integer n = 0; n < ROWS; ++n)
        wp::atomic_add(bias.gradient.data + bias_offset / SIZE + n, static_cast<real>(dy.c[n]));
""".replace("ROWS", str(spec.rows)).replace("SIZE", "2" if spec.bias == "float16" else "4")
    return f"""{accessors(spec)}{weights_and_bias(spec, with_bias=False)}
wp::vec_t<{spec.columns}, {C_TYPES[spec.dtype]}> dv;
real* gradient = matrix.gradient.data;
if (gradient) gradient += matrix_offset / {spec.format.bits // 8};
for (integer k = 0; k < {spec.columns}; ++k) {{
    const real x = round_value(static_cast<real>(v.c[k]));
    real sum = 0.0f;
    for (integer n = 0; n < {spec.rows}; ++n) {{
        const real d = static_cast<real>(dy.c[n]);
        sum += d * decode(bits(n, k));
        if (gradient) wp::atomic_add(gradient + index(n, k), d * x);
    }}
    dv.c[k] = {C_TYPES[spec.dtype]}(sum);
}}
{bias if with_bias else ""}return dv;
"""


def as_network(spec) -> tuple[NetworkSpec, LayerLayout]:
    """The product as a network of one layer, for the texts of `fragments`."""
    network = NetworkSpec(
        (spec.columns, spec.rows), activations.linear, activations.linear, spec.format, spec.accumulation,
        spec.dtype,
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


def tensor_product(spec, with_bias: bool) -> str:
    """The product for warps that arrive whole; several matrices in a warp are peeled as in `fragments`."""
    network, layer = as_network(spec)
    format, tiles = spec.format, layer.n_pad // 8
    kind, registers = primitives.accumulator(network)
    parts = 2 if primitives.packs_halves(network) else 4
    bias = [f"bias_at(2 * m + h, 8 * j + 2 * t + {e})" for e in (0, 1)]
    sums = [f"d[m][j][2 * h + {e}]" for e in (0, 1)]
    if format is INT8 or not with_bias:
        zero = "0x4b400000" if format is INT8 else "0"  # see fragments.start_tile
        start = f"UNROLL for (int r = 0; r < {registers}; ++r) d[m][j][r] = {zero};"
    elif spec.accumulation == "float16":
        start = f"UNROLL for (int h = 0; h < 2; ++h) d[m][j][h] = half_pack({bias[0]}, {bias[1]});"
    else:
        start = f"UNROLL for (int h = 0; h < 2; ++h) {{ {sums[0]} = {bias[0]}; {sums[1]} = {bias[1]}; }}"
    if format is INT8:
        add = [f" + {b}" if with_bias else "" for b in bias]
        sums = [f"__int_as_float({d}) - 12582912.0f{more}" for d, more in zip(sums, add, strict=True)]
    if spec.accumulation == "float16":
        result = "o[m][j][h] = d[m][j][h];"
    elif parts == 2:
        result = f"o[m][j][h] = half_pack({sums[0]}, {sums[1]});"
    else:
        result = f"o[m][j][h] = __float_as_uint({sums[0]}); o[m][j][2 + h] = __float_as_uint({sums[1]});"
    pointer = f"const {C_TYPES[wp.float16 if spec.bias == 'float16' else wp.float32]}*"
    rows = f"""{pointer} row_bias[4];
UNROLL for (int i = 0; i < 4; ++i) row_bias[i] = reinterpret_cast<{pointer}>(
    __shfl_sync(0xffffffffu, reinterpret_cast<unsigned long long>(biases), 8 * i + static_cast<integer>(g)));
auto bias_at = [&](integer i, integer n) -> real {{ return n < {spec.rows} ? bias_value(row_bias[i], n) : 0.0f; }};
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
{fragments.read_input(network, layer, scaled=False)}
{rows if with_bias else ""}
{kind} d[2][{tiles}][{registers}];
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {tiles}; ++j) {{ {start} }}
{multiply}
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {tiles}; ++j)
UNROLL for (int h = 0; h < 2; ++h) {{ {result} }}
{cuda.write_output(network, layer)}
return y;
"""
    return cuda.when_whole_warp(network, body)


def outer_product_text(spec) -> str:
    """Body of `outer_product_accumulate`."""
    fast = tensor_outer_product(spec) if spec.format in (FLOAT16, BFLOAT16) else ""
    return f"""{accessors(spec, stride="stride")}
real* const base_gradient = gradient.data + offset;
#if defined(__CUDA_ARCH__)
{fast}
#endif
for (integer n = 0; n < {spec.rows}; ++n) for (integer k = 0; k < {spec.columns}; ++k)
    wp::atomic_add(base_gradient + index(n, k),
        round_value(static_cast<real>(a.c[n])) * round_value(static_cast<real>(b.c[k])));
"""


def tensor_outer_product(spec) -> str:
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

    accumulate = f"""UNROLL for (int nb = 0; nb < {n_blocks}; ++nb) {{
unsigned left[2][4];
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int r = 0; r < 4; ++r)
    left[m][r] = transposed(fa[m][nb][r % 2 * 2 + r / 2] & keep[2 * m + r / 2]);
UNROLL for (int kb = 0; kb < {k_blocks}; ++kb) UNROLL for (int s = 0; s < 2; ++s) {{
    real dw[4] = {{0.0f, 0.0f, 0.0f, 0.0f}};
    UNROLL for (int m = 0; m < 2; ++m) multiply_add(dw, dw, left[m], right[m][kb][2 * s], right[m][kb][2 * s + 1]);
    UNROLL for (int r = 0; r < 4; ++r) {{
        const integer row = {row}, column = {column};
        if (row < {spec.rows} && column < {spec.columns}) add(const_cast<real*>(target) + index(row, column), dw[r]);
    }}
}} }}
"""
    peel = fragments.for_each_network("const real* target = reinterpret_cast<const real*>(base);\n" + accumulate)
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


def reduce_sum_text(n: int) -> str:
    """Body of `reduce_sum_accumulate`: a warp that arrives whole with one target adds its sum once."""
    return f"""using real = wp::float32; using integer = wp::int32;
real* const target = gradient.data + offset;
#if defined(__CUDA_ARCH__)
{ATOMICS}
{paste(NATIVE / "reduce_sum.cuh", N=n)}#endif
for (integer i = 0; i < {n}; ++i) wp::atomic_add(target + i, static_cast<real>(v.c[i]));
"""
