"""CUDA text of a network's adjoint on tensor cores, for the 16-bit formats.

The forward pass runs again, keeping pre-activations `z` as 16-bit pairs in the layout of the A operand; so are the
gradients `dz` with respect to them. Rows are samples. Layer by layer from the last:
- weights: dW = dz^T h has samples along K, so both operands are transposed 8 x 8 block by block (`movmatrix`);
- inputs: dh = dz W reads the same packed weights, transposed on the way.
Gradients are normalised by a power of two for the whole warp, so that no loss scale is needed for them to fit 16 bits;
products accumulate in float32, and are added to memory atomically in float32.

Runs of equal hidden layers are loops over `l`, and the tiles of dz a loop over `nb`, or compilation would take seconds.
"""

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.cuda import fragments, primitives
from warp_neural.kernels.coopvec.layout import LayerLayout, network_layout
from warp_neural.kernels.native import ATOMICS, paste
from warp_neural.kernels.nn.spec import C_TYPES, FLOAT16, NetworkSpec, round_up


def adjoint_text(spec: NetworkSpec) -> str:
    layers, _ = network_layout(spec, True)
    final = len(layers) - 1
    blocks = max(round_up(max(layer.k_pad, layer.n_pad), 16) // 16 for layer in layers)
    text = f"""{fragments.enter(spec)}
{prelude(spec)}
{fragments.ROWS}
real* my_gradient = params.master.grad;
if (my_gradient) my_gradient += static_cast<size_t>(params.network) * {spec.n_parameters};
unsigned a[2][{blocks}][4], h[2][{blocks}][4], dz[2][{blocks}][4], z[{final + 1}][2][{blocks}][4];
{fragments.read_input(spec, layers[0])}
unsigned input[2][{layers[0].k_blocks(spec.format)}][4];
{for_each_word(layers[0].k_blocks(spec.format), "input[m][b][r] = a[m][b][r];")}
"""
    for first, count in runs(layers):
        activate = for_each_word(layers[first].n_pad // 16, "a[m][b][r] = map(hidden, z[l][m][b][r]);")
        step = keep_pre_activations(spec, layers[first]) + (activate if first < final else "")
        text += layer_loop(layers, first, count, step, ascending=True)
    text += read_gradient(spec)
    for first, count in reversed(runs(layers)):
        layer, k_blocks = layers[first], layers[first].k_blocks(spec.format)
        inputs = "input[m][b][r]" if first == 0 else "map(hidden, z[l - 1][m][b][r])"
        step = f"""{for_each_word(k_blocks, f"h[m][b][r] = transposed({inputs});")}
real dh[2][{2 * k_blocks}][4];
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {2 * k_blocks}; ++j)
UNROLL for (int r = 0; r < 4; ++r) dh[m][j][r] = 0.0f;
{fragments.for_each_network(products(spec, layer))}
"""
        if first > 0:
            step += for_each_word(
                k_blocks,
                """const unsigned v = z[l - 1][m][b][r];
const real (&d)[4] = dh[m][2 * b + r / 2];
dz[m][b][r] = pack(d[r % 2 * 2] * d_hidden(low(v)), d[r % 2 * 2 + 1] * d_hidden(high(v)));""",
            )
        else:
            step += write_gradient(spec, layer)
        text += layer_loop(layers, first, count, step, ascending=False)
    return text + "return dx;\n"


def runs(layers: tuple[LayerLayout, ...]) -> list[tuple[int, int]]:
    """(first, count) of runs of equal layers; the first and the last layer of the network stand alone."""
    result, i = [], 0
    while i < len(layers):
        count = 1
        while (
            0 < i
            and i + count < len(layers) - 1
            and (layers[i + count].k, layers[i + count].n)
            == (
                layers[i].k,
                layers[i].n,
            )
        ):
            count += 1
        result.append((i, count))
        i += count
    return result


def layer_loop(layers, first: int, count: int, step: str, ascending: bool) -> str:
    """`step` for each layer l of a run; `at`, `master`: offsets from the run's first layer in words and floats."""
    stride = layers[first + 1].weights - layers[first].weights if count > 1 else 0
    master = layers[first + 1].master - layers[first].master if count > 1 else 0
    start, advance = (first, "++l") if ascending else (first + count - 1, "--l")
    return f"""{{ integer l = {start};
do {{
const unsigned at = (l - {first}) * {stride}u, master = (l - {first}) * {master}u;
{step}
{advance};
}} while (l >= {first} && l < {first + count}); }}
"""


def for_each_word(blocks: int, statement: str) -> str:
    return f"""UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int b = 0; b < {blocks}; ++b)
UNROLL for (int r = 0; r < 4; ++r) {{ {statement} }}
"""


def prelude(spec: NetworkSpec) -> str:
    ones = "0x3c003c00u" if spec.format is FLOAT16 else "0x3f803f80u"
    return f"""{primitives.mma("multiply_add", spec.format, "real")}{ATOMICS}
auto d_hidden = [](real z) -> real {{ return {spec.activation.derivative}; }};
auto d_last = [](real z) -> real {{ return {spec.output_activation.derivative}; }};
{paste(NATIVE / "gradients.cuh")}const unsigned ones = {ones};
"""


def keep_pre_activations(spec: NetworkSpec, layer: LayerLayout) -> str:
    """One layer forward: `z[l][m][b][r]`; an odd last tile is followed by zeros."""
    tiles = layer.n_pad // 8
    kind, registers = primitives.accumulator(spec)
    group = fragments.group_of(tiles)
    word = "d[m][j][h]" if spec.accumulation == "float16" else "pack(z_value(m, j, h, 0), z_value(m, j, h, 1))"
    return f"""{for_each_word(round_up(tiles, 2) // 2, "z[l][m][b][r] = 0u;") if tiles % 2 else ""}
UNROLL for (int j0 = 0; j0 < {tiles}; j0 += {group}) {{
{kind} d[2][{group}][{registers}];
{fragments.masked_products(spec, layer, group)}
{fragments.pre_activation(spec, layer)}
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {group}; ++j) UNROLL for (int h = 0; h < 2; ++h)
    z[l][m][(j0 + j) / 2][(j0 + j) % 2 * 2 + h] = {word};
}}
"""


def read_gradient(spec: NetworkSpec) -> str:
    """`dz` of the last layer from `dy`, normalised; `unscale` undoes that."""
    n_out, final = spec.sizes[-1], len(spec.layers) - 1
    blocks = round_up(n_out, 16) // 16
    units = []
    for unit in range(2 * blocks):
        pairs = [(8 * unit + 2 * t, 8 * unit + 2 * t + 1) for t in range(4)]
        value = [[f"static_cast<real>(dy.c[{n}]) * scale" if n < n_out else "0.0f" for n in p] for p in pairs]
        units.append([f"pack({low}, {high})" for low, high in value])
    return f"""real largest = 0.0f;
UNROLL for (int n = 0; n < {n_out}; ++n) largest = fmaxf(largest, fabsf(static_cast<real>(dy.c[n])));
UNROLL for (int bit = 16; bit > 0; bit /= 2) largest = fmaxf(largest, __shfl_xor_sync(0xffffffffu, largest, bit));
const integer exponent = min(max(static_cast<integer>(__float_as_uint(largest) >> 23), 4), 250);  // largest: 4 to 8
const real scale = __uint_as_float((256 - exponent) << 23), unscale = __uint_as_float((exponent - 2) << 23);
{fragments.read_rows(units, "dz")}
{
        for_each_word(
            blocks,
            f'''const unsigned v = dz[m][b][r], last_z = z[{final}][m][b][r];
dz[m][b][r] = pack(low(v) * d_last(low(last_z)), high(v) * d_last(high(last_z)));''',
        )
    }
"""


def products(spec: NetworkSpec, layer: LayerLayout) -> str:
    """One network's part of a layer: dW and db are added to memory, dz W to `dh`."""
    tiles, pairs, k_blocks = layer.n_pad // 8, layer.k_pairs(spec.format), layer.k_blocks(spec.format)
    n_blocks = round_up(tiles, 2) // 2
    low, high = "dw[2 * half] * unscale", "dw[2 * half + 1] * unscale"
    if layer.k % 2 == 0 and layer.master % 2 == 0 and spec.n_parameters % 2 == 0:
        add_pair = f"if (column + 2 * t < {layer.k}) add2(place, {low}, {high});"
    else:
        add_pair = f"if (column + 2 * t < {layer.k}) add(place, {low}); "
        add_pair += f"if (column + 2 * t + 1 < {layer.k}) add(place + 1, {high});"
    return f"""real* gradient = reinterpret_cast<real*>(
    __shfl_sync(0xffffffffu, reinterpret_cast<unsigned long long>(my_gradient), leader));
const uint4* weights = reinterpret_cast<const uint4*>(base + at + {layer.weights}) + lane;
integer nb = 0;
do {{
unsigned own_dz[2][4];
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int r = 0; r < 4; ++r) own_dz[m][r] = dz[m][nb][r] & keep[2 * m + r % 2];
if (gradient) {{
    unsigned dzt[2][4];
    UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int r = 0; r < 4; ++r)
        dzt[m][r] = transposed(own_dz[m][r % 2 * 2 + r / 2]);
    const integer n = 16 * nb + g;
    real* const dw_row = gradient + master + {layer.master} + n * {layer.k} + 2 * t;
    real* const db = gradient + master + {layer.master + layer.n * layer.k} + n;
    real sum[4] = {{0.0f, 0.0f, 0.0f, 0.0f}};
    UNROLL for (int m = 0; m < 2; ++m) multiply_add(sum, sum, dzt[m], ones, ones);
    UNROLL for (int s = 0; s < 2; ++s) if (t == 0 && n + 8 * s < {layer.n}) add(db + 8 * s, sum[2 * s] * unscale);
    UNROLL for (int b = 0; b < {k_blocks}; ++b) UNROLL for (int s = 0; s < 2; ++s) {{
        real dw[4] = {{0.0f, 0.0f, 0.0f, 0.0f}};
        UNROLL for (int m = 0; m < 2; ++m) multiply_add(dw, dw, dzt[m], h[m][b][2 * s], h[m][b][2 * s + 1]);
        const integer column = 16 * b + 8 * s;
        UNROLL for (int half = 0; half < 2; ++half) if (n + 8 * half < {layer.n}) {{
            real* const place = dw_row + 8 * half * {layer.k} + column;
            {add_pair}
        }}
    }}
}}
UNROLL for (int p = 0; p < {pairs}; ++p) {{
    const uint4 none = make_uint4(0u, 0u, 0u, 0u);
    const uint4 q0 = __ldg(weights + (2 * nb * {pairs} + p) * 32);
    const uint4 q1 = 2 * nb + 1 < {tiles} ? __ldg(weights + ((2 * nb + 1) * {pairs} + p) * 32) : none;
    const unsigned w0[4] = {{q0.x, q0.y, q0.z, q0.w}}, w1[4] = {{q1.x, q1.y, q1.z, q1.w}};
    UNROLL for (int s = 0; s < 4; ++s) if (2 * p + s / 2 < {k_blocks}) {{
        const unsigned b0 = transposed(w0[s]), b1 = transposed(w1[s]);
        UNROLL for (int m = 0; m < 2; ++m) multiply_add(dh[m][4 * p + s], dh[m][4 * p + s], own_dz[m], b0, b1);
    }}
}}
}} while (++nb < {n_blocks});
"""


def write_gradient(spec: NetworkSpec, layer: LayerLayout) -> str:
    """`dh` of the first layer, each thread's own row, to `dx`."""
    stores = []
    for unit in range(layer.k_pad // 4):
        columns = [(unit // 2 * 8 + unit % 2 + 2 * t, word) for t, word in enumerate("xyzw")]
        stores.append(
            " ".join(
                f"dx.c[{k}] = {C_TYPES[spec.dtype]}(__uint_as_float(v.{word}) * unscale);"
                for k, word in columns
                if k < spec.sizes[0]
            )
        )
    return fragments.write_rows(len(stores), "__float_as_uint(dh[i / 2][u / 2][i % 2 * 2 + u % 2])", stores)
