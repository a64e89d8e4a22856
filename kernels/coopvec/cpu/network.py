"""C++ text of a network for the CPU: one sample a call, vectors of 16 neurons in registers, rounded as tensor cores do.

The parameters are those that `layout.py` packs for the CPU. Each neuron's sum starts from the bias and takes its inputs
in order, one fused multiply-add each, so that CUDA's per-thread arithmetic gives the same bits.
"""

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.cpu.math import MATH, on_vectors
from warp_neural.kernels.coopvec.formats import SMALL_FLOATS
from warp_neural.kernels.coopvec.layout import MAGIC, LayerLayout, bias_joins_relu, network_layout
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.activations import relu
from warp_neural.kernels.nn.spec import BFLOAT16, FLOAT16, FLOAT32, INT8, TF32, Format, NetworkSpec, round_up

LANES = 16  # of one vector; the compiler splits it where registers are shorter
GROUP = 4  # vectors summed at once: enough to hide the latency of an addition, few enough for 16 short registers

PRELUDE = paste(NATIVE / "vectors.h")
ROUND = {
    FLOAT32: "return z;",
    TF32: "return z == z ? value((bits(z) + 0x1000u) & 0xffffe000u) : z;",  # cvt.rna: ties away from zero
    FLOAT16: "return half(z);",
    BFLOAT16: "return z == z ? value((bits(z) + 0x7fffu + (bits(z) >> 16 & 1u)) & 0xffff0000u) : z;",
    INT8: """
z = __builtin_elementwise_min(__builtin_elementwise_max(z, v16(-128.0f)), v16(127.0f));
return (z + 12582912.0f) - 12582912.0f;""",
}


def network_text(spec: NetworkSpec) -> str:
    """The body of `(params, x) -> y`."""
    n_out, last = spec.sizes[-1], len(spec.layers)
    layers = "".join(layer_text(spec, index, keep=False) for index in range(last))
    return f"""{prelude(spec)}{layers}
wp::vec_t<{n_out}, {c_type(spec)}> y;
for (int n = 0; n < {n_out}; ++n) y.c[n] = {c_type(spec)}(h{last}[n]);
return y;
"""


def adjoint_text(spec: NetworkSpec) -> str:
    """The body of its adjoint: forward again, keeping the pre-activations `z0`, ..., then back.

    In float32, with the rounded weights and vectors; rounding counts as identity, int8 as its dequantized values.
    """
    layers = range(len(spec.layers))
    text = prelude(spec) + "".join(layer_text(spec, index, keep=True) for index in layers)
    text += f"""{paste(NATIVE / "transposed_sum.h")}
real* grad = params.master.grad;
if (grad) grad += wp::int64(params.network) * {spec.n_parameters};
alignas(64) real d{len(layers)}[{round_up(spec.sizes[-1], LANES)}];
for (int n = 0; n < {spec.sizes[-1]}; ++n) d{len(layers)}[n] = static_cast<real>(dy.c[n]);
"""
    text += "".join(layer_adjoint_text(spec, index) for index in reversed(layers))
    return f"""{text}wp::vec_t<{spec.sizes[0]}, {c_type(spec)}> dx;
for (int k = 0; k < {spec.sizes[0]}; ++k) dx.c[k] = {c_type(spec)}(d0[k]);
return dx;
"""


def c_type(spec: NetworkSpec) -> str:
    return f"wp::{spec.dtype.__name__}"


def vector_prelude(spec: NetworkSpec) -> str:
    """Helpers for vectors of 16, functions that activations call among them, and `rounded` to the format."""
    calls = any("wp::" in f.value + f.derivative for f in (spec.activation, spec.output_activation))
    return f"{PRELUDE}{MATH if calls else ''}{rounding(spec.format)}"


def rounding(format: Format) -> str:
    """A lambda `rounded`."""
    if format in SMALL_FLOATS:
        return paste(NATIVE / "round_small_float.h", **SMALL_FLOATS[format])
    return f"const auto rounded = [&](v16 z) {{ {ROUND[format]} }};\n"


def prelude(spec: NetworkSpec) -> str:
    """Helpers, the network's parameters, and the rounded input vector `h0`."""
    n_in = spec.sizes[0]
    layers, words = network_layout(spec, False)
    first = "rounded(load(h0 + k))"
    if spec.format is INT8:  # clamped as a fraction of the range from -127 to 127 steps, as on tensor cores
        fraction = f"fma(load(h0 + k), v16(mine[{layers[0].scales}] * (1.0f / 254.0f)), v16(0.5f))"
        fraction = f"__builtin_elementwise_min(v16(1.0f), __builtin_elementwise_max(v16(0.0f), {fraction}))"
        first = f"fma({fraction}, v16(254.0f), v16({MAGIC - 127}f)) - {MAGIC}f"
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
        scale, fractions = f"v16(mine[{layer.scales + 3}])", f"b + {layer.fractions - layer.bias}"
        text += "".join(f"a{i} = fma(a{i} + {MAGIC}f, {scale}, load({fractions} + {i * LANES}));\n" for i in vectors)
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
            fraction = f"__builtin_elementwise_min(v16(1.0f), {a})"
            return f"fma({fraction}, v16(127.0f), v16({MAGIC}f)) - {MAGIC}f"
        return f"rounded({a}{input_scale(spec, layers[index + 1])})"
    return f"half({a})" if spec.accumulation == "float16" else a


def layer_adjoint_text(spec: NetworkSpec, index: int) -> str:
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
