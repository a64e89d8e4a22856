"""C++ text of a training step on the CPU, the way back: see `kernels.training.cpu.forward` for the names."""

from warp_neural.kernels.coopvec.cpu.math import on_vectors
from warp_neural.kernels.coopvec.cpu.network import LANES
from warp_neural.kernels.coopvec.layout import LayerLayout, network_layout
from warp_neural.kernels.nn.activations import linear
from warp_neural.kernels.nn.spec import NetworkSpec, round_up
from warp_neural.kernels.training.cpu.forward import enter, gradient_name, keeps_z, over_columns, over_samples, tile


def chunk_backward_text(spec: NetworkSpec, input_gradient: bool) -> str:
    """`(scratch, count)`: from the gradient of the results to all others, of the first `count` samples."""
    text = enter(spec)
    for l, layer in reversed(list(enumerate(network_layout(spec, False)[0]))):
        text += slopes(spec, l, layer) + weight_gradient(l, layer)
        if l > 0 or input_gradient:
            k = round_up(layer.k, LANES)
            text += over_samples(
                k,
                terms=str(layer.n),
                a=f"{gradient_name(l)}[i * {layer.n_pad} + t]",
                b=f"t{l} + t * {k} + j",
                start="v16(0.0f)",
                finish=f"store({gradient_name(l - 1)} + i * {k} + j, c);",
            )
    return text


def slopes(spec: NetworkSpec, index: int, layer: LayerLayout) -> str:
    """The gradient of a layer's activated results, to that of its pre-activations."""
    activation, n_pad = spec.activation_of(index), layer.n_pad
    derivative = activation.derivative if keeps_z(spec, index) else activation.slope_at_result
    if spec.activation_of(index) is linear:
        return ""
    d, z = gradient_name(index), f"z{index}" if keeps_z(spec, index) else f"h{index + 1}"
    vectors = on_vectors(derivative)
    if vectors:
        return f"""for (int i = 0; i < count * {n_pad}; i += {LANES}) {{
    const v16 z = load({z} + i);
    store({d} + i, load({d} + i) * {vectors});
}}
"""
    return f"""for (int i = 0; i < count; ++i) for (int n = 0; n < {layer.n}; ++n) {{
    const real z = {z}[i * {n_pad} + n];
    {d}[i * {n_pad} + n] *= {derivative};
}}
"""


def weight_gradient(index: int, layer: LayerLayout) -> str:
    """Adds to `g`: dW = dZ^T H, and the sums of dZ."""
    k, d, n, n_pad = round_up(layer.k, LANES), gradient_name(index), layer.n, layer.n_pad
    g = f"g{index} + i * {k} + j"
    product = {
        "columns": k,
        "terms": "count",
        "a": f"{d}[t * {n_pad} + i]",
        "b": f"h{index} + t * {k} + j",
        "start": "v16(0.0f)",
        "finish": f"store({g}, load({g}) + c);",
    }
    return f"""{{ constexpr int REST = {n} % ROWS;
{over_columns(k)} {{
for (int i0 = 0; i0 + ROWS <= {n}; i0 += ROWS) {{{tile("ROWS", **product)}}}
if constexpr (REST > 0) {{ constexpr int i0 = {n} - REST;{tile("REST", **product)}}}
}} }}
for (int j = 0; j < {n_pad}; j += {LANES}) {{
    v16 sum = v16(0.0f);
    for (int i = 0; i < count; ++i) sum += load({d} + i * {n_pad} + j);
    store(g{index} + {n * k} + j, load(g{index} + {n * k} + j) + sum);
}}
"""


def add_gradient_text(spec: NetworkSpec) -> str:
    """`(scratch, gradient) -> bool`: add to the gradient of all parameters, row major; is all that was added finite?"""
    text = f"""{enter(spec)}real check = 0.0f;
const auto add = [&](int at, real x) {{ gradient.data[at] += x; check += 0.0f * x; }};
"""
    for l, layer in enumerate(network_layout(spec, False)[0]):
        k = round_up(layer.k, LANES)
        text += f"""for (int n = 0; n < {layer.n}; ++n) {{
    for (int k = 0; k < {layer.k}; ++k) add({layer.master} + n * {layer.k} + k, g{l}[n * {k} + k]);
    add({layer.master + layer.n * layer.k} + n, g{l}[{layer.n * k} + n]);
}}
"""
    return text + "return check == 0.0f;\n"
