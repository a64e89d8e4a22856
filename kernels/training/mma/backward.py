"""CUDA text of a fused training step's backward pass: gradients to the layers' inputs and to their weights.

Names as in `kernels.training.mma.forward`. Layer by layer from the last: `dz`, the gradient to its pre-activations,
lies in the areas of all warps; each warp multiplies its own by the weights for the layer before, and everyone's
by the layer's inputs for its own tasks of the weights' gradient (see `schedule`), which it keeps in registers.
"""

from warp_neural.kernels.coopvec.cuda.fragments import unrolled
from warp_neural.kernels.nn.activations import SAME_SLOPE, linear, relu
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.mma.forward import enter
from warp_neural.kernels.training.mma.schedule import MmaSchedule
from warp_neural.kernels.training.text import take_dx


def start(spec: NetworkSpec, schedule: MmaSchedule) -> str:
    """The last layer's dz of each thread's own sample to the area."""
    final, n_out = schedule.layers[-1], spec.sizes[-1]
    text = ""
    for u in range(2 * final.n_blocks):
        pairs = [(8 * u + 2 * t, 8 * u + 2 * t + 1) for t in range(4)]
        values = [[f"dy.c[{n}] * d_last(z.c[{n}])" if n < n_out else "0.0f" for n in pair] for pair in pairs]
        words = ", ".join(f"pack({low}, {high})" for low, high in values)
        text += f"save_unit(own_unit(area + {4 * final.dz}, {final.n_blocks}, {u}), {words});\n"
    return text


def upper_layers_text(spec: NetworkSpec, schedule: MmaSchedule) -> str:
    """`(memory, sums, z, dy) -> sums`: all layers but the first; dy is of the activated results. All threads."""
    layers = "".join(backward_layer(spec, schedule, index, True) for index in reversed(range(1, len(schedule.layers))))
    return unrolled(f"{enter(spec, schedule)}auto sum = sums;\n{start(spec, schedule)}{layers}return sum;\n")


def first_layer_text(spec: NetworkSpec, schedule: MmaSchedule, input_gradient: bool) -> str:
    """`(memory, sums) -> sums`: the first layer; `input_gradient` leaves dx in the area. All threads."""
    layer = backward_layer(spec, schedule, 0, input_gradient)
    return unrolled(f"{enter(spec, schedule)}auto sum = sums;\n{layer}{schedule.barrier}\nreturn sum;\n")


def backward_layer(spec: NetworkSpec, schedule: MmaSchedule, index: int, go_on: bool) -> str:
    """Layer `index`, whose dz, of the whole block, lies in the areas after the barrier."""
    text = input_products(spec, schedule, index) if go_on else ""
    return f"{schedule.barrier}\n{{\n{text}{weight_products(spec, schedule, index)}}}\n"


def input_products(spec: NetworkSpec, schedule: MmaSchedule, index: int) -> str:
    """dh = dz W, times the slope of the layer before: that layer's dz, saved."""
    layer = schedule.layers[index]
    pairs, tiles, blocks = layer.layout.k_pairs(spec.format), layer.layout.n_pad // 8, layer.k_blocks
    target = 4 * (schedule.layers[index - 1].dz if index else schedule.dx)
    word = "pack(dh[m][2 * b + r / 2][r % 2 * 2], dh[m][2 * b + r / 2][r % 2 * 2 + 1])"
    if index == 0 or spec.activation is linear:
        word, kept = f"previous[r] = {word};", ""
    else:
        kept = f"unsigned kept[4]; load(area + {4 * layer.h} + (m * {blocks} + 2 * p + b) * 512, kept);"
        if spec.activation is relu:  # a positive half is not zero: then the sum's sign bit is set
            word = f"{word} & spread_signs(kept[r] + 0x7fff7fffu)"
        else:
            low, high = (
                f"dh[m][2 * b + r / 2][r % 2 * 2 + {e}] * d_hidden({side}(kept[r]))"
                for e, side in enumerate(("low", "high"))
            )
            word = f"pack({low}, {high})"
        word = f"previous[r] = {word};"
    second = f"2 * nb + 1 < {tiles}"
    return f"""unsigned dz[2][{layer.n_blocks}][4];
for (int m = 0; m < 2; ++m) for (int b = 0; b < {layer.n_blocks}; ++b)
    load(area + {4 * layer.dz} + (m * {layer.n_blocks} + b) * 512, dz[m][b]);
for (int p = 0; p < {pairs}; ++p) {{
real dh[2][4][4];
for (int m = 0; m < 2; ++m) for (int j = 0; j < 4; ++j) for (int r = 0; r < 4; ++r) dh[m][j][r] = 0.0f;
for (int nb = 0; nb < {layer.n_blocks}; ++nb) {{
    unsigned w0[4], w1[4] = {{0u, 0u, 0u, 0u}};
    load_transposed(weights + {4 * layer.weights} + (2 * nb * {pairs} + p) * 512, w0);
    if ({second}) load_transposed(weights + {4 * layer.weights} + ((2 * nb + 1) * {pairs} + p) * 512, w1);
    for (int j = 0; j < 4; ++j) if (2 * p + j / 2 < {blocks})
    for (int m = 0; m < 2; ++m) multiply_add(dh[m][j], dh[m][j], dz[m][nb], w0[j], w1[j]);
}}
for (int m = 0; m < 2; ++m) for (int b = 0; b < 2; ++b) if (2 * p + b < {blocks}) {{
    unsigned previous[4];
    {kept}
    for (int r = 0; r < 4; ++r) {{ {word} }}
    save(area + {target} + (m * {blocks} + 2 * p + b) * 512, previous);
}}
}}
"""


def weight_products(spec: NetworkSpec, schedule: MmaSchedule, index: int) -> str:
    """Add this warp's units of dZ^T H over its split of the block's samples to `sum`, loading one step ahead.

    Warps of different columns start at different samples, so that each adds the biases of others of them.
    """
    layer = schedule.layers[index]
    rows, columns, groups = layer.rows, layer.columns, layer.column_groups
    samples = schedule.warps // layer.splits
    shared_bias = samples % groups == 0
    restore = ""
    if index > 0 and spec.activation not in SAME_SLOPE:
        restore = (
            "for (int r = 0; r < 4; ++r) h[now][c][r] = pack(hidden(low(h[now][c][r])), hidden(high(h[now][c][r])));"
        )
    one = f"g == {index % 8}" if shared_bias else f"g == {index % 8} && turn == 0"
    return f"""{"" if layer.tasks * layer.splits == schedule.warps else f"if (warp < {layer.tasks * layer.splits}u)"} {{
const unsigned task = warp % {layer.tasks}u, split = warp / {layer.tasks}u, turn = task % {groups}u;
const unsigned one = {one} ? ones : 0u;  // the biases of layer l meet in column l % 8 of one product
const unsigned dz = areas + {4 * layer.dz} + task / {groups}u * {rows * 512} - lane * 16 + turned;
const unsigned from = areas + {4 * layer.h} + turn * {columns * 512};
unsigned d[2][{rows}][4], h[2][{columns}][4];
auto fetch = [&](int i, unsigned (&d)[{rows}][4], unsigned (&h)[{columns}][4]) {{
    const unsigned s = (split * {samples} + (i / 2 + turn) % {samples}) * {4 * schedule.area}, m = i % 2;
    for (int row = 0; row < {rows}; ++row) load_transposed(dz + s + (m * {layer.n_blocks} + row) * 512, d[row]);
    for (int c = 0; c < {columns}; ++c) load_transposed(from + s + (m * {layer.k_blocks} + c) * 512, h[c]);
}};
fetch(0, d[0], h[0]);
for (int i = 0; i < {2 * samples}; ++i) {{
    const int now = i % 2;
    if (i + 1 < {2 * samples}) fetch(i + 1, d[1 - now], h[1 - now]);
    for (int c = 0; c < {columns}; ++c) {{
        {restore}
        for (int row = 0; row < {rows}; ++row) for (int side = 0; side < 2; ++side) {{
            const int unit = (row * {columns} + c) * 2 + side;
            real (&dw)[4] = *reinterpret_cast<real (*)[4]>(sum.c + {layer.sums} + unit * 4);
            multiply_add(dw, dw, d[now][row], h[now][c][2 * side], h[now][c][2 * side + 1]);
        }}
    }}
    if ({f"i / 2 % {groups} == 0" if shared_bias else "true"}) for (int row = 0; row < {rows}; ++row) {{
        real (&db)[4] = *reinterpret_cast<real (*)[4]>(sum.c + {schedule.bias_sums(index)} + row * 4);
        multiply_add(db, db, d[now][row], one, one);
    }}
}} }}
"""


def input_gradient_text(spec: NetworkSpec, schedule: MmaSchedule, dtype: type) -> str:
    """`(memory) -> dx`, a vector of `dtype`, of this thread's sample, as `first_layer` left it."""
    blocks = schedule.layers[0].k_blocks
    take = take_dx(spec.sizes[0], dtype, lambda u: f"own_unit(area + {4 * schedule.dx}, {blocks}, {u})")
    return unrolled(f"{enter(spec, schedule)}{take}return dx;\n")
