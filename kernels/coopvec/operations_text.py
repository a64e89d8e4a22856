"""C++ text of the four operations: one portable per-thread form, and the tensor cores where a whole warp arrives."""

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.convert import layout_text
from warp_neural.kernels.coopvec.cuda.operations import WORDS, tensor_outer_product, tensor_product
from warp_neural.kernels.coopvec.formats import DECODE, ENCODE
from warp_neural.kernels.coopvec.fragment_layout import Text
from warp_neural.kernels.coopvec.product_types import PACKED, c_type
from warp_neural.kernels.native import ATOMICS, paste
from warp_neural.kernels.nn.spec import BFLOAT16, C_TYPES, FLOAT16

HALF_ATOMICS = paste(NATIVE / "half_atomics.cuh")


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


def operands(spec, with_bias: bool) -> str:
    """Lambdas: bits of the matrix, `bits(n, k)`, and of the vector in its format, `element(k)`; the bias's value.

    dense: whether words lie side by side. `bits_apart(n, k)` and `bias_apart(n)` serve where they do not.
    """
    if spec.dtype is PACKED:
        element = "v.c[k / 4] >> 8 * (k % 4) & 0xffu"
    elif spec.dtype is wp.int8:
        element = "static_cast<unsigned char>(v.c[k])"
    else:
        element = "encode(static_cast<real>(v.c[k]))"
    word = WORDS[spec.format.bits]
    dense = "matrix.data.strides[0] == 4" + (" && bias.data.strides[0] == 4" if with_bias else "")
    text = f"""const auto* elements = reinterpret_cast<const {word}*>(
    reinterpret_cast<const char*>(matrix.data.data) + matrix_offset);
const bool dense = {dense};
auto place = [](const auto& words, integer byte) {{
    return reinterpret_cast<const char*>(words.data) + (byte >> 2) * wp::int64(words.strides[0]) + (byte & 3); }};
auto bits = [&](integer n, integer k) -> unsigned {{ return elements[index(n, k)]; }};
auto bits_apart = [&](integer n, integer k) -> unsigned {{
    return *reinterpret_cast<const {word}*>(place(matrix.data, matrix_offset + sizeof({word}) * index(n, k))); }};
auto element = [&](integer k) -> unsigned {{ return {element}; }};
"""
    if with_bias:
        text += f"""const auto* biases = reinterpret_cast<const wp::{spec.bias}*>(
    reinterpret_cast<const char*>(bias.data.data) + bias_offset);
auto bias_value = [&](const wp::{spec.bias}* b, integer n) {{ return static_cast<{number(spec)}>(b[n]); }};
auto bias_here = [&](integer n) {{ return bias_value(biases, n); }};
auto bias_apart = [&](integer n) {{ return bias_value(
    reinterpret_cast<const wp::{spec.bias}*>(place(bias.data, bias_offset + sizeof(wp::{spec.bias}) * n)), 0); }};
"""
    return text


def number(spec) -> str:
    """C++ type of what is multiplied and added."""
    return "integer" if spec.result is wp.int32 else "real"


def product_text(spec, with_bias: bool) -> str:
    """Body of `matmul` and `matmul_add`."""
    step = spec.format.k_step
    half = spec.accumulation == "float16"
    exact = spec.result is wp.int32
    start = "bias_of(n)" if with_bias else "0" if exact else "0.0f"
    biases = [f", bias_{which}" if with_bias else ", 0" for which in ("here", "apart")]
    factor, total = ("static_cast<signed char>", "unsigned") if exact else ("decode", "real")  # integers wrap around
    rounding = f"if ((k + 1) % {max(step, 1)} == 0 || k + 1 == {spec.columns}) sum = round_half(sum);" if half else ""
    fast = tensor_product(spec, with_bias) if step else ""
    result = "round_half(sum)" if half else "sum"
    return f"""{accessors(spec)}{operands(spec, with_bias)}
wp::vec_t<{spec.rows}, {c_type(spec.result)}> y;
#if defined(__CUDA_ARCH__)
if (dense) {{
{fast}
}}
#endif
auto multiply = [&](auto bits_of, auto bias_of) {{
    {number(spec)} x[{spec.columns}];
    for (integer k = 0; k < {spec.columns}; ++k) x[k] = {factor}(element(k));
    for (integer n = 0; n < {spec.rows}; ++n) {{
        {total} sum = {f"round_half({start})" if half else start};
        for (integer k = 0; k < {spec.columns}; ++k) {{ sum += x[k] * {factor}(bits_of(n, k)); {rounding} }}
        y.c[n] = {result};
    }}
}};
if (dense)
    multiply(bits{biases[0]});
else
    multiply(bits_apart{biases[1]});
return y;
"""


def product_adjoint_text(spec, with_bias: bool) -> str:
    """Per thread: gradients of floats in the vector, and atomically of matrix and bias where they have an array."""
    bias = """if (bias.gradient.data)
    for (integer n = 0; n < ROWS; ++n)
        wp::atomic_add(bias.gradient.data + (bias_offset / SIZE + n) * (bias.gradient.strides[0] / 4),
            static_cast<real>(dy.c[n]));
""".replace("ROWS", str(spec.rows)).replace("SIZE", "2" if spec.bias == "float16" else "4")
    to_vector = f"dv.c[k] = {c_type(spec.dtype)}(sum);" if spec.dtype in C_TYPES else ""
    return f"""{accessors(spec)}{operands(spec, with_bias=False)}
wp::vec_t<{spec.vec_in._length_}, {c_type(spec.dtype)}> dv{{}};
real* gradient = matrix.gradient.data;
const wp::int64 step = matrix.gradient.strides[0] / 4;
if (gradient) gradient += matrix_offset / {spec.format.bits // 8} * step;
auto multiply = [&](auto bits_of) {{
    for (integer k = 0; k < {spec.columns}; ++k) {{
        const real x = decode(element(k));
        real sum = 0.0f;
        for (integer n = 0; n < {spec.rows}; ++n) {{
            const real d = static_cast<real>(dy.c[n]);
            sum += d * decode(bits_of(n, k));
            if (gradient) wp::atomic_add(gradient + index(n, k) * step, d * x);
        }}
        {to_vector}
    }}
}};
if (dense)
    multiply(bits);
else
    multiply(bits_apart);
{bias if with_bias else ""}return dv;
"""


def outer_product_text(spec, gradient_dtype: type) -> str:
    """Body of `outer_product_accumulate`."""
    target, half = c_type(gradient_dtype), gradient_dtype is wp.float16
    add = "add_half" if half else "wp::atomic_add"
    fast = tensor_outer_product(spec, gradient_dtype) if spec.format in (FLOAT16, BFLOAT16) else ""
    return f"""{accessors(spec, stride="stride")}
{HALF_ATOMICS if half else ""}
const wp::int64 step = gradient.strides[0] / static_cast<integer>(sizeof({target}));
{target}* const base_gradient = gradient.data + offset * step;
#if defined(__CUDA_ARCH__)
if (step == 1) {{
{fast}
}}
#endif
for (integer n = 0; n < {spec.rows}; ++n) for (integer k = 0; k < {spec.columns}; ++k)
    {add}(base_gradient + index(n, k) * step,
        round_value(static_cast<real>(a.c[n])) * round_value(static_cast<real>(b.c[k])));
"""


def reduce_sum_text(n: int, gradient_dtype: type) -> str:
    """Body of `reduce_sum_accumulate`: a warp that arrives whole with one target adds its sum once."""
    half = gradient_dtype is wp.float16
    names = "auto add = add_half; auto add2 = add_half2;" if half else ATOMICS
    return f"""using real = wp::float32; using integer = wp::int32;
{HALF_ATOMICS if half else ""}
const wp::int64 step = gradient.strides[0] / static_cast<integer>(sizeof({c_type(gradient_dtype)}));
{c_type(gradient_dtype)}* const target = gradient.data + offset * step;
#if defined(__CUDA_ARCH__)
{names}
{paste(NATIVE / "reduce_sum.cuh", N=n, WIDTH=2 if half else 1)}#endif
for (integer i = 0; i < {n}; ++i)
    {"add_half" if half else "wp::atomic_add"}(target + i * step, static_cast<real>(v.c[i]));
"""
