"""C++ text of a training step on the CPU: many samples against one load of the weights, all in float32 vectors.

Samples are taken CHUNK at a time, so that their vectors stay in the cache. Every product, forward and back, is a matrix
product in tiles of registers: `rows` scalars spread over a vector times a few vectors. Rounding is that of
`kernels.coopvec.cpu.network`: rounded weights and vectors between layers, gradients in float32.

Scratch memory, one float32 array (`areas`), of each layer l: `h` its inputs [CHUNK, k], rounded; `z` its
pre-activations [CHUNK, n], where they are kept; `t` its weights [n, k]; `g` its gradient, weights [n, k], then biases
[n]. The results lie in the last `h`, and `d0` and `d1` hold gradients to vectors [CHUNK, n], those of layer l in
d(l % 2), those of the network's input in d1. Rows are padded to whole vectors.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.cpu.math import on_vectors
from warp_neural.kernels.coopvec.cpu.network import LANES, result, vector_prelude
from warp_neural.kernels.coopvec.layout import bias_joins_relu, network_layout
from warp_neural.kernels.nn.spec import FLOAT32, NetworkSpec, round_up

CHUNK = 64  # samples, a multiple of ROWS

ROWS = """
#if defined(__AVX512F__)
constexpr int ROWS = 8;  // of a tile: 16 sums of 32 registers
#else
constexpr int ROWS = 2;
#endif
"""

PARAMETERS = "const real* const mine = reinterpret_cast<const real*>(params.packed.data);\n"


def keeps_z(spec: NetworkSpec, index: int) -> bool:
    """8-bit formats round small results to zero, where ReLU's derivative is another."""
    is_last = index == len(spec.layers) - 1
    lifted = bool(spec.activation_of(index).slope_at_result) and (is_last or spec.format.bits > 8)
    return not lifted


@cache
def areas(spec: NetworkSpec) -> tuple[dict[str, int], int]:
    """Where each array starts in the scratch memory, and the size of all, in floats."""
    layers, _ = network_layout(spec, False)
    sizes = {f"h{len(layers)}": CHUNK * layers[-1].n_pad}
    for l, layer in enumerate(layers):
        k = round_up(layer.k, LANES)
        sizes |= {f"h{l}": CHUNK * k, f"t{l}": layer.n * k, f"g{l}": layer.n * k + layer.n_pad}
        if keeps_z(spec, l):
            sizes[f"z{l}"] = CHUNK * layer.n_pad
    widest = max(round_up(size, LANES) for size in spec.sizes)
    sizes |= {"d0": CHUNK * widest, "d1": CHUNK * widest}
    starts, end = {}, 0
    for name, size in sizes.items():
        starts[name] = end
        end += round_up(size, LANES)
    return starts, end


def enter(spec: NetworkSpec) -> str:
    """Helpers and the names of all arrays."""
    starts, _ = areas(spec)
    arrays = "".join(f"real* const {name} = scratch.data + {start};\n" for name, start in starts.items())
    return f"{vector_prelude(spec)}{ROWS}{arrays}"


def begin_text(spec: NetworkSpec) -> str:
    """`(params, scratch)`: turn the weights for the way back, clear the gradient."""
    text = enter(spec) + PARAMETERS
    for l, layer in enumerate(network_layout(spec, False)[0]):
        k = round_up(layer.k, LANES)
        text += f"""for (int n = 0; n < {layer.n}; ++n) for (int k = 0; k < {layer.k}; ++k)
    t{l}[n * {k} + k] = mine[{layer.weights} + k * {layer.n_pad} + n];
for (int i = 0; i < {layer.n * k + layer.n_pad}; ++i) g{l}[i] = 0.0f;
"""
    return text


def write(row: str, vector: str, n: int) -> str:
    """Store `vector` of n floats at `row`."""
    return f"for (int n = 0; n < {n}; ++n) ({row})[n] = static_cast<real>({vector}.c[n]);\n"


def write_input_text(spec: NetworkSpec) -> str:
    """`(scratch, i, x)`."""
    return enter(spec) + write(f"h0 + i * {round_up(spec.sizes[0], LANES)}", "x", spec.sizes[0])


def read_result_text(spec: NetworkSpec) -> str:
    """`(scratch, i) -> y`."""
    last = network_layout(spec, False)[0][-1]
    return read(spec, last.n, f"h{len(spec.layers)} + i * {last.n_pad}")


def write_gradient_text(spec: NetworkSpec) -> str:
    """`(scratch, i, dy)`."""
    last = network_layout(spec, False)[0][-1]
    return enter(spec) + write(f"{gradient_name(len(spec.layers) - 1)} + i * {last.n_pad}", "dy", last.n)


def read_input_gradient_text(spec: NetworkSpec) -> str:
    """`(scratch, i) -> dx`."""
    return read(spec, spec.sizes[0], f"{gradient_name(-1)} + i * {round_up(spec.sizes[0], LANES)}")


def read(spec: NetworkSpec, n: int, row: str) -> str:
    return f"""{enter(spec)}wp::vec_t<{n}, real> y;
for (int n = 0; n < {n}; ++n) y.c[n] = ({row})[n];
return y;
"""


def gradient_name(layer: int) -> str:
    return f"d{layer % 2}"


def tile(rows: str, columns: int, terms: str, a: str, b: str, start: str, finish: str, between="") -> str:
    """Sums c over t < `terms` of `a` (a float of row i) times `b` (a pointer to the vectors of columns from j on).

    start: the sum's first value; finish: what uses `c` of (i, j); between: what to do with all sums after each term.
    """
    vectors = 2 if columns % (2 * LANES) == 0 else 1
    each = f"""
#pragma unroll
for (int r = 0; r < {rows}; ++r)
#pragma unroll
for (int v = 0; v < {vectors}; ++v)"""
    return f"""
v16 sums[{rows}][{vectors}];{each} {{ const int j = j0 + v * {LANES}; sums[r][v] = {start}; }}
for (int t = 0; t < {terms}; ++t) {{
    v16 w[{vectors}];
#pragma unroll
    for (int v = 0; v < {vectors}; ++v) {{ const int j = j0 + v * {LANES}; w[v] = load({b}); }}
#pragma unroll
    for (int r = 0; r < {rows}; ++r) {{
        const int i = i0 + r;
        const v16 x = v16({a});
#pragma unroll
        for (int v = 0; v < {vectors}; ++v) sums[r][v] = fma(x, w[v], sums[r][v]);
    }}
    {between.format(each=each)}
}}{each} {{ const int i = i0 + r, j = j0 + v * {LANES}; v16 c = sums[r][v]; {finish} }}
"""


def over_columns(columns: int) -> str:
    return f"for (int j0 = 0; j0 < {columns}; j0 += {2 * LANES if columns % (2 * LANES) == 0 else LANES})"


def over_samples(columns: int, **product: str) -> str:
    """A product with a row for each sample; up to ROWS - 1 rows after the last are computed and never read."""
    return f"""{over_columns(columns)} for (int i0 = 0; i0 < count; i0 += ROWS) {{
{tile("ROWS", columns, **product)}}}
"""


def chunk_forward_text(spec: NetworkSpec) -> str:
    """`(params, scratch, count)`: all layers of the first `count` samples."""
    text = enter(spec) + PARAMETERS
    k = round_up(spec.sizes[0], LANES)
    if spec.format is not FLOAT32:
        text += f"for (int i = 0; i < count * {k}; i += {LANES}) store(h0 + i, rounded(load(h0 + i)));\n"
    return text + "".join(forward_layer(spec, l) for l in range(len(spec.layers)))


def forward_layer(spec: NetworkSpec, index: int) -> str:
    layer, value = network_layout(spec, False)[0][index], spec.activation_of(index).value
    half, last = spec.accumulation == "float16", index == len(spec.layers) - 1
    late, k, out = bias_joins_relu(spec, last), round_up(layer.k, LANES), f"h{index + 1} + i * {layer.n_pad} + j"
    bias = f"load(mine + {layer.bias} + j)"
    between, step = "", spec.format.k_step
    if half:
        rounding = "{each} sums[r][v] = half(sums[r][v]);"
        between = f"if ((t + 1) % {step} == 0 || t + 1 == {layer.k}) {{{{ {rounding} }}}}"
    finish = f"c = half(c + half({bias}));\n" if late else ""
    finish += f"store(z{index} + i * {layer.n_pad} + j, c);\n" if keeps_z(spec, index) else ""
    rounded = result(spec, index, "c")
    if last and spec.dtype is wp.float16:
        rounded = f"half({rounded})"
    vectors = on_vectors(value)
    if vectors:
        finish += f"{{ const v16 z = c; c = {vectors}; }}\nstore({out}, {rounded});"
    else:
        finish += f"store({out}, c);"
    text = over_samples(
        layer.n_pad,
        terms=str(layer.k),
        a=f"h{index}[i * {k} + t]",
        b=f"mine + {layer.weights} + t * {layer.n_pad} + j",
        start="v16(0.0f)" if late else f"half({bias})" if half else bias,
        between=between,
        finish=finish,
    )
    if not vectors:
        text += f"""for (int i = 0; i < count; ++i) {{
    real* const row = h{index + 1} + i * {layer.n_pad};
    for (int n = 0; n < {layer.n}; ++n) {{ const real z = row[n]; row[n] = {value}; }}
    for (int n = 0; n < {layer.n_pad}; n += {LANES}) {{ const v16 c = load(row + n); store(row + n, {rounded}); }}
}}
"""
    return text
