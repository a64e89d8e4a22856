"""CUDA text of a network in per-thread arithmetic: float32, and any format where lanes of the warp are missing.

The same packed parameters and the same rounding as on the tensor cores, one sample a thread.
"""

from dataclasses import replace

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.formats import DECODE, ENCODE
from warp_neural.kernels.coopvec.fragment_layout import Text
from warp_neural.kernels.coopvec.layout import (
    MAGIC,
    LayerLayout,
    bias_is_half,
    bias_joins_relu,
    bias_layout,
    network_layout,
)
from warp_neural.kernels.native import ATOMICS, paste
from warp_neural.kernels.nn.activations import relu
from warp_neural.kernels.nn.spec import C_TYPES, FLOAT32, INT8, NetworkSpec


def conversions(spec: NetworkSpec) -> str:
    """Lambdas: decode and encode of the format, `round_value` to it, `round_half`."""
    return f"""using real = wp::float32; using integer = wp::int32;
auto decode = [](unsigned b) -> real {{ {DECODE[spec.format]} }};
auto encode = [](real x) -> unsigned {{ {ENCODE[spec.format]} }};
auto round_value = [&](real x) {{ return decode(encode(x)); }};
auto round_half = [](real x) {{ return wp::half_to_float(wp::float_to_half(x)); }};
"""


def read_row(spec: NetworkSpec, layer: LayerLayout, use: str) -> str:
    """Statements `use` for every weight of neuron n, in order of K blocks: `w` its value, `k` its column."""
    format = spec.format
    if format.k_step == 0:
        return f"""const float4* weights = reinterpret_cast<const float4*>(net + {layer.weights} + n * {layer.k_pad});
for (int c = 0; c < {layer.k_pad // 4}; ++c) {{
const float4 four = __ldg(weights + c);
const real values[4] = {{four.x, four.y, four.z, four.w}};
for (int e = 0; e < 4; ++e) {{ const int k = 4 * c + e; const real w = values[e]; {use} }}
}}
"""
    pairs, blocks, operands = layer.k_pairs(format), layer.k_blocks(format), layer.operands(format)
    (rows, columns), memory = operands.axes, operands.memory
    elements, units = memory.only("e", "upper"), memory.only("t", "g", "pair", "tile")
    t, p = Text("t"), Text("p")
    column = columns.join(**elements.split(Text("e")), t=t, register=Text("r"), half=Text("b"), pair=p)
    return f"""const uint4* weights = reinterpret_cast<const uint4*>(net + {layer.weights})
    + {units.join(**rows.split(Text("n")))};
integer p = 0;
do {{
uint4 q[4];
for (int t = 0; t < 4; ++t) q[t] = __ldg(weights + {units.join(t=t, pair=p)});
for (int b = 0; b < 2; ++b) {{ const int kb = 2 * p + b; if (kb < {blocks}) {{
for (int t = 0; t < 4; ++t) for (int r = 0; r < 2; ++r) {{
    const unsigned word = b ? (r ? q[t].w : q[t].z) : (r ? q[t].y : q[t].x);
    for (int e = 0; e < {format.per_word}; ++e) {{
        const int k = {column};
        const real w = decode(word >> (e * {format.bits % 32}));
        {use}
    }} }}
{"acc = round_half(acc);" if spec.accumulation == "float16" and use.startswith("acc") else ""}
}} }}
}} while (++p < {pairs});
"""


def load_bias(spec: NetworkSpec, layer: LayerLayout) -> str:
    """The bias of neuron n."""
    if spec.format.k_step == 0:
        return f"__uint_as_float(__ldg(net + {layer.bias} + n))"
    index = bias_layout(spec, layer.n_pad).index(Text("n"))
    if bias_is_half(spec, cuda=True):
        return f"wp::half_to_float(reinterpret_cast<const wp::half*>(net + {layer.bias})[{index}])"
    return f"__uint_as_float(__ldg(net + {layer.bias} + {index}))"


def round_input(spec: NetworkSpec, layer: LayerLayout, value: str) -> str:
    """`value` as the layer multiplies it; INT8: the integer."""
    if spec.format is INT8:
        return f"round_value({value} * __uint_as_float(__ldg(net + {layer.scales})))"
    return value if spec.format is FLOAT32 else f"round_value({value})"


def layer_input(spec: NetworkSpec, i: int, index: str = "k") -> str:
    """Expression of input `index` of layer i, recomputed from the pre-activations of the layer before."""
    layer = network_layout(spec, True)[0][i]
    raw = f"static_cast<real>(x.c[{index}])" if i == 0 else f"hidden(z{i - 1}[{index}])"
    if i > 0 and spec.format is INT8 and spec.activation is relu:  # the arithmetic of the tensor-core path
        return f"(fmaf(fminf({raw}, 1.0f), 127.0f, {MAGIC}f) - {MAGIC}f)"
    if i == 0 and spec.format is INT8:
        scale = f"__uint_as_float(__ldg(net + {layer.scales})) * (1.0f / 254.0f)"
        return f"(fmaf(__saturatef(fmaf({raw}, {scale}, 0.5f)), 254.0f, {MAGIC - 127}f) - {MAGIC}f)"
    return round_input(spec, layer, raw)


def run_layers(spec: NetworkSpec) -> str:
    """Pre-activations `z0`, `z1`, ... of every layer; INT8 before ReLU: fractions of the next layer's largest."""
    layers, words = network_layout(spec, True)
    text = (
        conversions(spec)
        + f"""
auto hidden = [](real z) -> real {{ return {spec.activation.value}; }};
auto last = [](real z) -> real {{ return {spec.output_activation.value}; }};
const unsigned* net = params.packed.data + static_cast<size_t>(params.network) * {words};
"""
    )
    for i, layer in enumerate(layers):
        is_last = i == len(layers) - 1
        late = bias_joins_relu(spec, is_last)
        start = "0.0f" if spec.format is INT8 or late else load_bias(spec, layer)
        finish = f"round_half(acc + {load_bias(spec, layer)})" if late else "acc"
        if spec.format is INT8 and spec.activation is relu and not is_last:
            fraction = f"__uint_as_float(__ldg(net + {layer.scales + 3}))"
            finish = f"fmaf(acc + {MAGIC}f, {fraction}, {load_bias(spec, replace(layer, bias=layer.fractions))})"
        elif spec.format is INT8:
            finish = f"fmaf(acc, __uint_as_float(__ldg(net + {layer.scales + 1})), {load_bias(spec, layer)})"
        text += f"""real z{i}[{layer.n}];
{{ real h[{layer.k_pad}];
#pragma unroll 4
for (int k = 0; k < {layer.k_pad}; ++k) h[k] = 0.0f;
#pragma unroll 4
for (int k = 0; k < {layer.k}; ++k) h[k] = {layer_input(spec, i)};
int n = 0;
do {{
real acc = {start};
{read_row(spec, layer, "acc = fmaf(h[k], w, acc);")}
z{i}[n] = {finish};
}} while (++n < {layer.n}); }}
"""
    return text


def network_text(spec: NetworkSpec) -> str:
    """Returns the result; the caller has named the types `Params`, `X` and `Y`.

    A function of its own, never inlined, or a network 256 wide would take the compiler three times as long.
    """
    value = f"last(z{len(spec.layers) - 1}[n])"
    if spec.dtype is wp.float16:
        value = f"wp::half({value})"
    elif spec.accumulation == "float16" and spec.format.k_step > 0:
        value = f"round_half({value})"
    return f"""struct Scalar {{
static __device__ __noinline__ void run(const Params& params, const X& x, Y& y) {{
{run_layers(spec)}
#pragma unroll 4
for (int n = 0; n < {spec.sizes[-1]}; ++n) y.c[n] = {value};
}} }};
Params own_params = params; X own_x = x; Y result;  // copies: what a call takes by reference leaves the registers
Scalar::run(own_params, own_x, result);
return result;
"""


def adjoint_text(spec: NetworkSpec, warps: bool) -> str:
    """Returns `dx`, adds to the gradient of the master parameters; `dy` is the gradient of the result.

    warps: whole warps may arrive with one network, and then sum their gradients first.
    """
    layers, _ = network_layout(spec, True)
    final = len(layers) - 1
    text = f"""{run_layers(spec)}
auto d_hidden = [](real z) -> real {{ return {spec.activation.derivative}; }};
auto d_last = [](real z) -> real {{ return {spec.output_activation.derivative}; }};
{ATOMICS}
real* gradient = params.master.grad;
if (gradient) gradient += static_cast<size_t>(params.network) * {spec.n_parameters};
{paste(NATIVE / "warp_sums.cuh") if warps else "constexpr bool together = false;"}
real dz{final}[{spec.sizes[-1]}];
#pragma unroll 4
for (int n = 0; n < {spec.sizes[-1]}; ++n) dz{final}[n] = static_cast<real>(dy.c[n]) * d_last(z{final}[n]);
"""
    for i in range(final, -1, -1):
        layer = layers[i]
        # INT8 multiplies integers: back to their values
        input_step = f"1.0f / __uint_as_float(__ldg(net + {layer.scales}))" if spec.format is INT8 else "1.0f"
        product_step = f"__uint_as_float(__ldg(net + {layer.scales + 1}))" if spec.format is INT8 else "1.0f"
        sums = f"if (together) Sums::of(h, dz{i}, {layer.k}, {layer.n}, weights_of, biases_of);\n" if warps else ""
        text += f"""real dh{i}[{layer.k_pad}];
{{ real h[{layer.k_pad}];
const real input_step = {input_step}, weight_step = {product_step} / input_step;
#pragma unroll 4
for (int k = 0; k < {layer.k_pad}; ++k) dh{i}[k] = h[k] = 0.0f;
#pragma unroll 4
for (int k = 0; k < {layer.k}; ++k) h[k] = {layer_input(spec, i)} * input_step;
real* const weights_of = gradient + {layer.master};
real* const biases_of = weights_of + {layer.n * layer.k};
{sums}int n = 0;
do {{
const real dz = dz{i}[n];
if (gradient && !together) {{
    add(biases_of + n, dz);
    for (int k = 0; k < {layer.k}; ++k) add(weights_of + n * {layer.k} + k, dz * h[k]);
}}
{read_row(spec, layer, f"dh{i}[k] = fmaf(dz * weight_step, w, dh{i}[k]);")}
}} while (++n < {layer.n}); }}
"""
        if i > 0:
            text += f"""real dz{i - 1}[{layer.k}];
#pragma unroll 4
for (int k = 0; k < {layer.k}; ++k) dz{i - 1}[k] = dh{i}[k] * d_hidden(z{i - 1}[k]);
"""
    return text + f"for (int k = 0; k < {spec.sizes[0]}; ++k) dx.c[k] = {C_TYPES[spec.dtype]}(dh0[k]);\nreturn dx;\n"
