"""C++ text of a network for the CPU: one sample a call, vectors of 16 neurons in registers, rounded as tensor cores do.

The parameters are those that `layout.py` packs for the CPU. Each neuron's sum starts from the bias and takes its inputs
in order, one fused multiply-add each, so that CUDA's per-thread arithmetic gives the same bits.
"""

from warp_neural.kernels.coopvec.cpu.math import MATH, on_vectors
from warp_neural.kernels.coopvec.layout import MAGIC, LayerLayout, bias_joins_relu, network_layout
from warp_neural.kernels.nn.activations import relu
from warp_neural.kernels.nn.spec import BFLOAT16, E4M3, E5M2, FLOAT16, FLOAT32, INT8, TF32, NetworkSpec, round_up

LANES = 16  # of one vector; the compiler splits it where registers are shorter
GROUP = 4  # vectors summed at once: enough to hide the latency of an addition, few enough for 16 short registers

PRELUDE = """
using real = wp::float32;
typedef real v16 __attribute__((ext_vector_type(16)));
typedef unsigned u16 __attribute__((ext_vector_type(16)));
typedef _Float16 h16 __attribute__((ext_vector_type(16)));
const auto load = [](const real* p) { return *reinterpret_cast<const v16*>(p); };
const auto store = [](real* p, v16 z) { *reinterpret_cast<v16*>(p) = z; };
const auto fma = [](v16 x, v16 y, v16 z) { return __builtin_elementwise_fma(x, y, z); };
const auto bits = [](v16 z) { return __builtin_bit_cast(u16, z); };
const auto value = [](u16 b) { return __builtin_bit_cast(v16, b); };
const auto half = [](v16 z) { return __builtin_convertvector(__builtin_convertvector(z, h16), v16); };
"""

# 16 vectors to one: element i is the sum of p[i]. Interleaving halves at each step leaves the sums in order
TRANSPOSED_SUM = """
const auto halves = [](v16 a, v16 b) {
    return __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23)
        + __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
};
const auto transposed_sum = [&](v16* p) {
    for (int i = 0; i < 8; ++i) p[i] = halves(p[i], p[i + 8]);
    for (int i = 0; i < 4; ++i) p[i] = halves(p[i], p[i + 4]);
    return halves(halves(p[0], p[2]), halves(p[1], p[3]));
};
"""


def small_float_round(mantissa: int, min_exponent: int, largest: float) -> str:
    """The addition of 1.5 * 2^23 steps leaves whole steps, rounded to even; the step follows from the exponent of z."""
    return f"""
const u16 magnitude = bits(z) & 0x7fffffffu;
const v16 a = value(magnitude) > {largest}f ? v16({largest}f) : value(magnitude);
const u16 exponent = __builtin_elementwise_max(bits(a) & 0x7f800000u, u16({127 + min_exponent}u << 23));
const v16 shift = value((exponent + ({23 - mantissa}u << 23)) | 0x400000u);
return value(bits((a + shift) - shift) | (bits(z) & 0x80000000u));"""


ROUND = {
    FLOAT32: "return z;",
    TF32: "return z == z ? value((bits(z) + 0x1000u) & 0xffffe000u) : z;",  # cvt.rna: ties away from zero
    FLOAT16: "return half(z);",
    BFLOAT16: "return z == z ? value((bits(z) + 0x7fffu + (bits(z) >> 16 & 1u)) & 0xffff0000u) : z;",
    E4M3: small_float_round(3, -6, 448.0),
    E5M2: small_float_round(2, -14, 57344.0),
    INT8: """
z = __builtin_elementwise_min(__builtin_elementwise_max(z, v16(-127.0f)), v16(127.0f));
return (z + 12582912.0f) - 12582912.0f;""",
}


def forward(spec: NetworkSpec) -> str:
    """The body of `(params, x) -> y`."""
    n_out, last = spec.sizes[-1], len(spec.layers)
    layers = "".join(layer_text(spec, index, keep=False) for index in range(last))
    return f"""{prelude(spec)}{layers}
wp::vec_t<{n_out}, {c_type(spec)}> y;
for (int n = 0; n < {n_out}; ++n) y.c[n] = {c_type(spec)}(h{last}[n]);
return y;
"""


def adjoint(spec: NetworkSpec) -> str:
    """The body of its adjoint: forward again, keeping the pre-activations `z0`, ..., then back.

    In float32, with the rounded weights and vectors; rounding counts as identity, int8 as its dequantized values.
    """
    layers = range(len(spec.layers))
    text = prelude(spec) + "".join(layer_text(spec, index, keep=True) for index in layers)
    text += f"""{TRANSPOSED_SUM}
real* grad = params.master.grad;
if (grad) grad += wp::int64(params.network) * {spec.n_parameters};
alignas(64) real d{len(layers)}[{round_up(spec.sizes[-1], LANES)}];
for (int n = 0; n < {spec.sizes[-1]}; ++n) d{len(layers)}[n] = static_cast<real>(dy.c[n]);
"""
    text += "".join(layer_adjoint(spec, index) for index in reversed(layers))
    return f"""{text}wp::vec_t<{spec.sizes[0]}, {c_type(spec)}> dx;
for (int k = 0; k < {spec.sizes[0]}; ++k) dx.c[k] = {c_type(spec)}(d0[k]);
return dx;
"""


def c_type(spec: NetworkSpec) -> str:
    return f"wp::{spec.dtype.__name__}"


def vector_prelude(spec: NetworkSpec) -> str:
    """Helpers for vectors of 16, functions that activations call among them, and `rounded` to the format."""
    calls = any("wp::" in f.value + f.derivative for f in (spec.activation, spec.output_activation))
    return f"{PRELUDE}{MATH if calls else ''}const auto rounded = [&](v16 z) {{ {ROUND[spec.format]} }};\n"


def prelude(spec: NetworkSpec) -> str:
    """Helpers, the network's parameters, and the rounded input vector `h0`."""
    n_in = spec.sizes[0]
    layers, words = network_layout(spec, False)
    first = "rounded(load(h0 + k))"
    if spec.format is INT8:  # clamped as a share of the range from -127 to 127 steps, as on tensor cores
        share = f"fma(load(h0 + k), v16(mine[{layers[0].scales}] * (1.0f / 254.0f)), v16(0.5f))"
        share = f"__builtin_elementwise_min(v16(1.0f), __builtin_elementwise_max(v16(0.0f), {share}))"
        first = f"fma({share}, v16(254.0f), v16({MAGIC - 127}f)) - {MAGIC}f"
    return f"""{vector_prelude(spec)}
const real* mine = reinterpret_cast<const real*>(params.packed.data) + wp::int64(params.network) * {words};
alignas(64) real h0[{round_up(n_in, LANES)}] = {{}};
for (int k = 0; k < {n_in}; ++k) h0[k] = static_cast<real>(x.c[k]);
for (int k = 0; k < {n_in}; k += {LANES}) store(h0 + k, {first});
"""


def input_scale(spec: NetworkSpec, layer: LayerLayout) -> str:
    return f" * mine[{layer.scales}]" if spec.format is INT8 else ""


def layer_text(spec: NetworkSpec, index: int, keep: bool) -> str:
    """`h{index}` to `h{index + 1}`, the rounded input of the next layer or the result; with keep, also `z{index}`."""
    layer, activation = network_layout(spec, False)[0][index], spec.activation_of(index)
    h = f"h{index + 1}"
    inline = on_vectors(activation.value)
    text = f"alignas(64) real {h}[{layer.n_pad}]{f', z{index}[{layer.n_pad}]' if keep else ''};\n"
    for n in range(0, layer.n_pad, GROUP * LANES):
        vectors = range(min(GROUP, (layer.n_pad - n) // LANES))
        text += f"{{\n{sums(spec, layer, index, n, vectors)}"
        for i in vectors:
            here = n + i * LANES
            text += f"store(z{index} + {here}, a{i});\n" if keep else ""
            text += f"{{ const v16 z = a{i}; a{i} = {inline}; }}\n" if inline else ""
            text += f"store({h} + {here}, {result(spec, index, f'a{i}') if inline else f'a{i}'});\n"
        text += "}\n"
    if not inline:
        text += f"for (int n = 0; n < {layer.n}; ++n) {{ const real z = {h}[n]; {h}[n] = {activation.value}; }}\n"
        vector = result(spec, index, f"load({h} + n)")
        text += f"for (int n = 0; n < {layer.n_pad}; n += {LANES}) store({h} + n, {vector});\n"
    return text


def sums(spec: NetworkSpec, layer: LayerLayout, index: int, n: int, vectors: range) -> str:
    """Pre-activations of the neurons from n on, in the vectors `a0`, `a1`, ..."""
    is_int8, is_half, is_last = spec.format is INT8, spec.accumulation == "float16", index == len(spec.layers) - 1
    late = bias_joins_relu(spec, is_last)
    text = f"const real* w = mine + {layer.weights + n};\nconst real* b = mine + {layer.bias + n};\n"
    for i in vectors:
        bias = f"load(b + {i * LANES})"
        text += f"v16 a{i} = {'v16(0.0f)' if is_int8 or late else f'half({bias})' if is_half else bias};\n"
    products = f"const v16 v = v16(h{index}[k]);\n"
    products += "".join(f"a{i} = fma(v, load(w + k * {layer.n_pad} + {i * LANES}), a{i});\n" for i in vectors)
    if is_half:
        step = spec.format.k_step
        rounding = "".join(f"a{i} = half(a{i});\n" for i in vectors)
        text += f"for (int block = 0; block < {layer.k}; block += {step}) {{\n"
        text += f"for (int k = block; k < wp::min(block + {step}, {layer.k}); ++k) {{\n{products}}}\n{rounding}}}\n"
    else:
        text += f"for (int k = 0; k < {layer.k}; ++k) {{\n{products}}}\n"
    if late:
        text += "".join(f"a{i} = half(a{i} + half(load(b + {i * LANES})));\n" for i in vectors)
    if is_int8 and spec.activation is relu and not is_last:
        scale, shares = f"v16(mine[{layer.scales + 3}])", f"b + {layer.shares - layer.bias}"
        text += "".join(f"a{i} = fma(a{i} + {MAGIC}f, {scale}, load({shares} + {i * LANES}));\n" for i in vectors)
    elif is_int8:
        scale = f"v16(mine[{layer.scales + 1}])"
        text += "".join(f"a{i} = fma(a{i}, {scale}, load(b + {i * LANES}));\n" for i in vectors)
    return text


def result(spec: NetworkSpec, index: int, a: str) -> str:
    """The activations `a` as the next layer takes them, or as the caller does."""
    layers, _ = network_layout(spec, False)
    if index < len(layers) - 1:
        if spec.format is INT8 and spec.activation is relu:
            # as the tensor-core path does: clamp to [0, 1], then round 127 times that by adding 1.5 * 2^23
            share = f"__builtin_elementwise_min(v16(1.0f), {a})"
            return f"fma({share}, v16(127.0f), v16({MAGIC}f)) - {MAGIC}f"
        return f"rounded({a}{input_scale(spec, layers[index + 1])})"
    return f"half({a})" if spec.accumulation == "float16" else a


def layer_adjoint(spec: NetworkSpec, index: int) -> str:
    """`d{index + 1}`, the gradient of the layer's result, to `d{index}` of its input; adds to `grad`."""
    layer = network_layout(spec, False)[0][index]
    k, n, n_pad = layer.k, layer.n, layer.n_pad
    d, h = f"d{index + 1}", f"h{index}"
    is_int8 = spec.format is INT8
    step_in, step = f" / mine[{layer.scales}]", f" * mine[{layer.scales}] * mine[{layer.scales + 1}]"
    terms = "\n".join(f"p[i] = fma(load(row + {i}), load({d} + {i}), p[i]);" for i in range(LANES, n_pad, LANES))
    return f"""
for (int n = 0; n < {n}; ++n) {{ const real z = z{index}[n]; {d}[n] *= {spec.activation_of(index).derivative}; }}
for (int n = {n}; n < {n_pad}; ++n) {d}[n] = 0.0f;
if (grad) for (int n = 0; n < {n}; ++n) {{
    const real g = {d}[n]{step_in if is_int8 else ""};
    grad[{layer.master + n * k} + n] += {d}[n];
    for (int k = 0; k < {k}; ++k) grad[{layer.master} + n * {k} + k] += g * {h}[k];
}}
alignas(64) real d{index}[{round_up(k, LANES)}];
for (int k = 0; k < {k}; k += {LANES}) {{
    v16 p[{LANES}];
    for (int i = 0; i < {LANES}; ++i) {{
        const real* row = mine + {layer.weights} + wp::min(k + i, {k - 1}) * {n_pad};
        p[i] = load(row) * load({d});
        {terms}
    }}
    store(d{index} + k, transposed_sum(p){step if is_int8 else ""});
}}
"""
