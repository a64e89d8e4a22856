"""CUDA text of a fused training step: what all parts share, and the forward pass.

Names as in `kernels.coopvec.cuda.fragments`: samples are rows (32 a warp, tiles `m`, halves `h`), neurons columns
(tiles `j`, K blocks `b`), lane = 4 g + t. Vectors pass through shared memory as 8 x 8 matrices of 128 contiguous
bytes, each lane's 16 bytes beside its neighbours', so that no access meets a bank conflict: matrix r of block (m, b)
holds the rows of half r % 2 and the columns of half r / 2, register r of an A operand.

The functions share registers (`sums`, which the kernel passes along) and shared memory (`schedule.MmaSchedule`).
"""

from pathlib import Path

from warp_neural.kernels.coopvec.cuda import network as cuda
from warp_neural.kernels.coopvec.cuda import primitives
from warp_neural.kernels.coopvec.cuda.fragments import group_of, pre_activation, start_tile
from warp_neural.kernels.coopvec.layout import network_layout
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.mma.schedule import MmaSchedule
from warp_neural.kernels.training.text import ones_of, slopes

NATIVE = Path(__file__).parent / "native"


def enter(spec: NetworkSpec, schedule: MmaSchedule) -> str:
    """Lambdas, and the addresses `weights` (of the block), `area` (of this warp) and others; see `places.cuh`."""
    add = primitives.mma("multiply_add", spec.format, "real")
    names = (
        f"{primitives.prelude(spec)}{add}{slopes(spec)}{primitives.MATRICES}const unsigned ones = {ones_of(spec)};\n"
    )
    return names + paste(NATIVE / "places.cuh", WEIGHTS=4 * schedule.weights, AREA=4 * schedule.area)


def begin_text(spec: NetworkSpec, schedule: MmaSchedule) -> str:
    """`(params, memory)`: stage the weights, 8 x 8 matrices in the order of the packed buffer. All threads."""
    _, words = network_layout(spec, True)
    copies = "".join(
        f"""UNROLL for (int i = 0; i < {layer.layout.bias - layer.layout.weights}; i += {4 * schedule.threads}) {{
    const unsigned word = i + 4 * threadIdx.x;
    if (word < {layer.layout.bias - layer.layout.weights}u) {{
        const uint4 v = __ldg(reinterpret_cast<const uint4*>(mine + {layer.layout.weights} + word));
        unsigned* const matrices = target + {layer.weights} + word / 128 * 128 + word % 128 / 4;
        matrices[0] = v.x; matrices[32] = v.y; matrices[64] = v.z; matrices[96] = v.w;
    }}
}}
"""
        for layer in schedule.layers
    )
    return f"""const unsigned* mine = params.packed.data + static_cast<size_t>(params.network) * {words};
unsigned* target = reinterpret_cast<unsigned*>(memory.data.ptr);
{copies}__syncthreads();
"""


def forward_text(spec: NetworkSpec, schedule: MmaSchedule) -> str:
    """`(params, memory, x) -> z`, the last layer's pre-activations; keeps each layer's input in the warp's area."""
    n_in, n_out, blocks = spec.sizes[0], spec.sizes[-1], schedule.layers[0].k_blocks
    _, words = network_layout(spec, True)
    units = []
    for u in range(2 * blocks):
        pairs = [(8 * u + 2 * t, 8 * u + 2 * t + 1) for t in range(4)]
        values = [[f"static_cast<real>(x.c[{k}])" if k < n_in else "0.0f" for k in pair] for pair in pairs]
        units.append([f"pack({low}, {high})" for low, high in values])
    body = f"""{enter(spec, schedule)}
const unsigned* base = params.packed.data + static_cast<size_t>(params.network) * {words};
const unsigned* const row[4] = {{base, base, base, base}};
const unsigned at = 0u;
unsigned a[2][{max(layer.k_blocks for layer in schedule.layers)}][4];
{"".join(f"save_unit(own_unit(area, {blocks}, {u}), {', '.join(unit)});" for u, unit in enumerate(units))}
__syncwarp();
UNROLL for (int m = 0; m < 2; ++m)
UNROLL for (int b = 0; b < {blocks}; ++b) load(area + (m * {blocks} + b) * 512, a[m][b]);
{"".join(forward_layer(spec, schedule, index) for index in range(len(schedule.layers)))}
__syncwarp();
wp::vec_t<{n_out}, real> result;
{"".join(read_result(schedule, n_out, j) for j in range(schedule.layers[-1].layout.n_pad // 8))}
return result;
"""
    return body


def forward_layer(spec: NetworkSpec, schedule: MmaSchedule, index: int) -> str:
    layer, is_last = schedule.layers[index], index == len(schedule.layers) - 1
    layout, tiles = layer.layout, layer.layout.n_pad // 8
    group, blocks = group_of(tiles), layer.k_blocks
    kind, registers = primitives.accumulator(spec)
    if is_last:
        address = f"area + {4 * schedule.output} - lane * 8 + ((m * {tiles} + j0 + j) * 2 + h) * 256"
        finish = f"""asm volatile("st.shared.v2.f32 [%0],{{%1,%2}};"
    :: "r"({address}), "f"(z_value(m, j, h, 0)), "f"(z_value(m, j, h, 1)) : "memory");"""
        declare = copy = ""
    else:
        kept = "next" if spec.activation.slope_at_result else "z"
        declare = f"unsigned next[2][{tiles // 2}][4]{'' if kept == 'next' else f', z[2][{tiles // 2}][4]'};"
        finish = cuda.to_next(spec, layout)
        if kept == "z":
            z = "d[m][j][h]" if spec.accumulation == "float16" else "pack(z_value(m, j, h, 0), z_value(m, j, h, 1))"
            finish += f" z[m][(j0 + j) / 2][(j0 + j) % 2 * 2 + h] = {z};"
        copy = f"""UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int b = 0; b < {tiles // 2}; ++b) {{
    save(area + {4 * schedule.layers[index + 1].h} + (m * {tiles // 2} + b) * 512, {kept}[m][b]);
    UNROLL for (int r = 0; r < 4; ++r) a[m][b][r] = next[m][b][r];
}}"""
    return f"""{{ {declare}
UNROLL for (int j0 = 0; j0 < {tiles}; j0 += {group}) {{
{kind} d[2][{group}][{registers}];
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {group}; ++j) {{
{kind} (&c)[{registers}] = d[m][j];
{start_tile(spec, layout)} }}
UNROLL for (int p = 0; p < {layout.k_pairs(spec.format)}; ++p) {{
    unsigned w[{group}][4];
    UNROLL for (int j = 0; j < {group}; ++j)
        load(weights + {4 * layer.weights} + ((j0 + j) * {layout.k_pairs(spec.format)} + p) * 512, w[j]);
    UNROLL for (int b = 0; b < 2; ++b) if (2 * p + b < {blocks}) UNROLL for (int j = 0; j < {group}; ++j)
    UNROLL for (int m = 0; m < 2; ++m) multiply(d[m][j], d[m][j], a[m][2 * p + b], w[j][2 * b], w[j][2 * b + 1]);
}}
{pre_activation(spec, layout)}
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int j = 0; j < {group}; ++j)
UNROLL for (int h = 0; h < 2; ++h) {{ {finish} }}
}}
{copy} }}
"""


def read_result(schedule: MmaSchedule, n_out: int, j: int) -> str:
    """Columns 8 j .. 8 j + 7 of this lane's own row of results."""
    tiles = schedule.layers[-1].layout.n_pad // 8
    text = f"""{{ unsigned v[4];
const unsigned from = area - lane * 16 + {4 * schedule.output}
    + (((lane >> 4) * {tiles} + {j}) * 2 + (lane >> 3 & 1u)) * 256 + (lane & 7u) * 32;
"""
    for half in range(2):
        columns = [(8 * j + 4 * half + i, i) for i in range(4) if 8 * j + 4 * half + i < n_out]
        if columns:
            text += f"load_unit(from + {16 * half}, v);\n"
            text += "".join(f"result.c[{n}] = __uint_as_float(v[{i}]);\n" for n, i in columns)
    return text + "}\n"
