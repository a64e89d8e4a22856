"""CUDA text of a network: layers fused on tensor cores where a whole warp arrives, per-thread arithmetic elsewhere.

The names in the text are those of `fragments`.
"""

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.cuda import adjoint as cuda_adjoint
from warp_neural.kernels.coopvec.cuda import scalar as cuda_scalar
from warp_neural.kernels.coopvec.cuda.fragments import (
    ROWS,
    bias_words,
    enter,
    group_of,
    load_weights,
    masked_products,
    pre_activation,
    read_input,
    start_tile,
    write_rows,
)
from warp_neural.kernels.coopvec.cuda.primitives import accumulator, packs_halves
from warp_neural.kernels.coopvec.layout import LayerLayout, bias_joins_relu, network_layout
from warp_neural.kernels.native import paste, unroll
from warp_neural.kernels.nn.activations import leaky_relu, linear, relu
from warp_neural.kernels.nn.spec import BFLOAT16, C_TYPES, FLOAT16, INT8, TF32, NetworkSpec


def network_text(spec: NetworkSpec) -> str:
    """The snippet's CUDA body."""
    if spec.format.k_step == 0:
        return types(spec) + cuda_scalar.network_text(spec)
    body = whole_warp(spec, read_input(spec, network_layout(spec, True)[0][0]))
    return types(spec) + when_whole_warp(spec, body) + cuda_scalar.network_text(spec)


def rows_text(spec: NetworkSpec) -> str:
    """The body of `(params, x: array2d, row, pool) -> y` for a whole warp with consecutive rows of x, see `rows`."""
    read = paste(NATIVE / "stage_rows.cuh", INPUT_UNITS=spec.sizes[0] // 8)
    return types(spec) + when_whole_warp(spec, whole_warp(spec, read)) + "return y;\n"


def types(spec: NetworkSpec) -> str:
    n_in, n_out, c_type = spec.sizes[0], spec.sizes[-1], C_TYPES[spec.dtype]
    return f"""using real = wp::float32; using Params = decltype(params);
using X = wp::vec_t<{n_in}, {c_type}>; using Y = wp::vec_t<{n_out}, {c_type}>; Y y;
"""


def whole_warp(spec: NetworkSpec, read: str) -> str:
    """All layers of a warp's 32 samples; `read` deals the inputs to the first layer's A operand."""
    layers, _ = network_layout(spec, True)
    blocks = max(layer.k_blocks(spec.format) for layer in layers)
    tiles, parts = layers[-1].n_pad // 8, 2 if packs_halves(spec) else 4
    return f"""{enter(spec)}
const unsigned long long first = __shfl_sync(0xffffffffu, key, 0);
unsigned a[2][{blocks}][4], o[2][{tiles}][{parts}];
{read}
if (__all_sync(0xffffffffu, key == first)) {{
const unsigned* base = reinterpret_cast<const unsigned*>(first);
const unsigned* row[4] = {{base, base, base, base}};
{layers_text(spec, masked=False)}
}} else {{
{ROWS}
{layers_text(spec, masked=True)}
}}
{write_output(spec, layers[-1])}
return y;
"""


def adjoint_text(spec: NetworkSpec) -> str:
    """The adjoint snippet's CUDA body: 16-bit formats on tensor cores, the others in per-thread arithmetic."""
    start = f"wp::vec_t<{spec.sizes[0]}, {C_TYPES[spec.dtype]}> dx;\n"
    if spec.format not in (FLOAT16, BFLOAT16) or max(spec.sizes) > 128:
        return start + cuda_scalar.adjoint_text(spec, warps=True)
    return start + when_whole_warp(spec, cuda_adjoint.adjoint_text(spec)) + cuda_scalar.adjoint_text(spec, warps=False)


def when_whole_warp(spec: NetworkSpec, body: str) -> str:
    """`body` for warps that arrive with all 32 lanes, on architectures that multiply the format."""
    return unroll(f"""#if __CUDA_ARCH__ >= {spec.format.min_arch * 10}
if (__activemask() == 0xffffffffu) {{
{body}}}
#endif
""")


def layers_text(spec: NetworkSpec, masked: bool) -> str:
    """All layers; a run of equal hidden layers is a loop, which keeps the code in the instruction cache."""
    layers, _ = network_layout(spec, True)
    text, i = "unsigned at = 0u;\n", 0
    while i < len(layers):
        run = 1
        while i + run < len(layers) - 1 and (layers[i + run].k_pad, layers[i + run].n_pad) == (
            layers[i].k_pad,
            layers[i].n_pad,
        ):
            run += 1
        body = layer_text(spec, layers[i], i == len(layers) - 1, masked)
        if run > 1:
            stride = layers[i + 1].weights - layers[i].weights
            body = f"do {{ {body} at += {stride}u; }} while (at < {run * stride}u);\nat = 0u;\n"
        text, i = text + body, i + run
    return text


def layer_text(spec: NetworkSpec, layer: LayerLayout, is_last: bool, masked: bool) -> str:
    """One layer: bias, products, activation; `a` becomes the next layer's operand, or `o` is set."""
    tiles = layer.n_pad // 8
    group = group_of(tiles)
    kind, registers = accumulator(spec)
    finish = to_output(spec) if is_last else to_next(spec, layer)
    if masked:
        multiply = masked_products(spec, layer, group)
    elif bias_joins_relu(spec, is_last):
        multiply = products(spec, layer, group, "c[0] = c[1] = 0u;")
        finish = f"""unsigned c[2];
{bias_words(spec, layer, "j0 + j", "base")}
next[m][(j0 + j) / 2][(j0 + j) % 2 * 2 + h] = half_add_relu(d[m][j][h], c[h]);"""
    else:
        multiply = products(spec, layer, group, start_tile(spec, layer))
    blocks = 0 if is_last else layer.n_pad // spec.format.k_step
    declare = "" if is_last else f"unsigned next[2][{blocks}][4];"
    copy = "" if is_last else "a[m][b][r] = next[m][b][r];"
    # wide layers: a loop, with `next` in local memory, rather than minutes of compilation
    loop = "\n#pragma unroll 1\nfor (auto j0 = 0;" if tiles > 16 else "UNROLL for (int j0 = 0;"
    return f"""{{ {declare}
{loop} j0 < {tiles}; j0 += {group}) {{
{kind} d[2][{group}][{registers}];
{multiply}
{pre_activation(spec, layer)}
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {group}; ++j)
UNROLL for (int h = 0; h < 2; ++h) {{ {finish} }}
}}
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int b = 0; b < {blocks}; ++b)
UNROLL for (int r = 0; r < 4; ++r) {{ {copy} }}
}}
"""


def products(spec: NetworkSpec, layer: LayerLayout, group: int, start: str) -> str:
    """`d[m][j]` for `group` tiles from `j0` on: one matrix for the whole warp. start: sets `c`, the value before."""
    kind, registers = accumulator(spec)
    blocks = layer.k_blocks(spec.format)
    return f"""UNROLL for (int p = 0; p < {layer.k_pairs(spec.format)}; ++p) {{
{load_weights(spec, layer, group)}
UNROLL for (int b = 0; b < 2; ++b) if (2 * p + b < {blocks})
UNROLL for (int j = 0; j < {group}; ++j) {{
const unsigned b0 = b ? q[j].z : q[j].x, b1 = b ? q[j].w : q[j].y;
UNROLL for (int m = 0; m < 2; ++m) {{
    if (p + b == 0) {{
        {kind} c[{registers}];
        {start}
        multiply(d[m][j], c, a[m][0], b0, b1);
    }} else multiply(d[m][j], d[m][j], a[m][2 * p + b], b0, b1);
}} }} }}
"""


def to_next(spec: NetworkSpec, layer: LayerLayout) -> str:
    """Body of loops m, j, h: activate the tiles `d[m][j]` and convert them to the next layer's A operand."""
    format = spec.format
    in_place = {relu: "half_max({d}, 0u)", leaky_relu: "half_leak({d})", linear: "{d}"}
    if format is TF32:
        return "UNROLL for (int e = 0; e < 2; ++e) next[m][j0 + j][2 * e + h] = pack(hidden(z_value(m, j, h, e)));"
    if format.bits == 16:
        word = "pack(hidden(z_value(m, j, h, 0)), hidden(z_value(m, j, h, 1)))"
        if spec.activation is relu:
            word = "pack_relu(z_value(m, j, h, 0), z_value(m, j, h, 1))"
        if spec.accumulation == "float16" and spec.activation in in_place:
            word = in_place[spec.activation].format(d="d[m][j][h]")
        return f"next[m][(j0 + j) / 2][(j0 + j) % 2 * 2 + h] = {word};"
    if spec.accumulation == "float16" and spec.activation is relu:
        word = "pack_relu(d[m][j][h], d[m][j + 1][h])"
    else:
        function, z, scale = "pack", "hidden(z_value(m, j + {o}, h, {e}))", ""
        if format is INT8 and spec.activation is relu:
            function, z = "pack_fractions", "fraction_value(m, j + {o}, h, {e})"
        elif format is INT8:
            scale = f" * (__uint_as_float(__ldg(row[2 * m + h] + at + {layer.scales + 2})) * 127.0f)"
        word = f"{function}({', '.join(z.format(o=o, e=e) + scale for o in (0, 1) for e in (0, 1))})"
    return f"if (j % 2 == 0) next[m][(j0 + j) / 4][(j0 + j) / 2 % 2 * 2 + h] = {word};"


def to_output(spec: NetworkSpec) -> str:
    if spec.accumulation == "float16" and spec.output_activation is linear:
        return "o[m][j0 + j][h] = d[m][j][h];"
    if packs_halves(spec):
        return "o[m][j0 + j][h] = half_pack(last(z_value(m, j, h, 0)), last(z_value(m, j, h, 1)));"
    return "UNROLL for (int e = 0; e < 2; ++e) o[m][j0 + j][2 * e + h] = __float_as_uint(last(z_value(m, j, h, e)));"


def write_output(spec: NetworkSpec, layer: LayerLayout, cast: str = "__uint_as_float") -> str:
    """Collect each thread's own row into the vector `y`: a unit holds 8 halves, or the 4 words 8 j + 2 t + e."""
    parts = 1 if packs_halves(spec) else 2
    stores = []
    for unit in range(layer.n_pad // 8 * parts):
        first = unit // parts * 8 + unit % parts
        columns = [(first + 2 * t + odd, word, odd) for t, word in enumerate("xyzw") for odd in range(3 - parts)]
        stores.append(
            " ".join(store(spec, n, f"v.{word}", odd, cast) for n, word, odd in columns if n < spec.sizes[-1])
        )
    return write_rows(len(stores), f"o[i / 2][u / {parts}][u % {parts} * 2 + i % 2]", stores)


def store(spec: NetworkSpec, n: int, word: str, odd: int, cast: str) -> str:
    if not packs_halves(spec):
        return f"y.c[{n}] = {cast}({word});"
    if spec.dtype is wp.float16:
        return f"y.c[{n}].u = static_cast<unsigned short>({word} >> {16 * odd});"
    return f"y.c[{n}] = half_{('low', 'high')[odd]}({word});"
