"""CUDA text of a fused training step by warpgroups (`wgmma`, sm_90a): what all parts share, and the forward pass.

Names as in `kernels.training.mma.forward`, but that a tile `m` is 64 samples, of which each warp has 16 rows. Vectors
stay in registers from layer to layer, as `wgmma` leaves results the way it takes its first operand. Slots (see
`hopper64.schedule`) have the layout that both operands of `wgmma` can be read from, with either dimension inside: the
16-byte units of a row are swizzled by the row's low three bits (PTX ISA, matrix descriptors, 128-byte swizzling). The
two tiles of a layer take turns: while one is multiplied, the other's results are activated.
"""

from pathlib import Path

from warp_neural.kernels.coopvec.cuda import primitives
from warp_neural.kernels.coopvec.cuda.warpgroups import PRODUCTS, wait, wgmma
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.activations import linear, relu
from warp_neural.kernels.nn.spec import FLOAT16, NetworkSpec
from warp_neural.kernels.training.hopper64.schedule import ROW, SAMPLES, SLOT, WIDTH, Hopper64Schedule, HopperSchedule
from warp_neural.kernels.training.text import ones_of, slopes

NATIVE = Path(__file__).parent / "native"


def enter(spec: NetworkSpec, schedule: Hopper64Schedule) -> str:
    """Lambdas; addresses of the block's `weights` and of the warpgroup's `area`, and places in its slots."""
    where = {"ONES": schedule.ones, "AREAS": schedule.areas, "AREA": schedule.area}
    places = paste(NATIVE / "places.cuh", ROW=ROW, SAMPLES=SAMPLES, **where)
    return f"{primitives.prelude(spec)}{slopes(spec)}{primitives.MATRICES}{PRODUCTS}{places}"


def forward_text(spec: NetworkSpec, schedule: Hopper64Schedule, halves: bool) -> str:
    """`(params, memory, x, kept, start) -> z`, the last layer's pre-activations; keeps each layer's input.

    halves: x is float16. kept, start: of networks of 128 neurons, memory and the first sample of a round.
    """
    final, k_pad, depth = schedule.layers[-1].layout, schedule.layers[0].layout.k_pad, len(schedule.layers) - 1
    inputs = save_inputs(spec, schedule, halves)
    if k_pad < WIDTH:  # the column of ones; beyond 64 columns it lies elsewhere
        inputs += f"save_unit(unit(0, {k_pad // 8}), {', '.join([ones_of(spec)] * 4)});\n"
    layers = "".join(activate(spec, schedule, index) for index in range(depth))
    multiply = wgmma("multiply_hidden", spec, WIDTH, "registers", False)
    multiply += wgmma("multiply_last", spec, final.n_pad, "registers", False)
    return f"""{enter(spec, schedule)}{multiply}{read_biases(schedule, WIDTH)}{inputs}__syncwarp();
unsigned a[2][{WIDTH // 16}][4];
real d[2][{WIDTH // 2}], z[2][{final.n_pad // 2}];
UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int b = 0; b < {k_pad // 16}; ++b) load(matrices(0, m, b), a[m][b]);
UNROLL for (int m = 0; m < 2; ++m) {{ {products(schedule, 0)} }}
{layers}
UNROLL for (int m = 0; m < 2; ++m) {{
if (m == 0) {{ {wait(1, "z[0]")} }} else {{ {wait(0, "z[1]")} }}
{save_results(schedule, "z[m]", "m * 64 + ")}}}
{read_results(schedule)}"""


def save_inputs(spec: NetworkSpec, schedule: HopperSchedule, halves: bool) -> str:
    """This thread's x, to its row of the first slot."""
    text = ""
    for u in range(schedule.layers[0].layout.k_pad // 8):
        words = (input_word(spec.sizes[0], 8 * u + 2 * t, halves and spec.format is FLOAT16) for t in range(4))
        text += f"save_unit(unit(0, {u}), {', '.join(words)});\n"
    return text


def read_biases(schedule: HopperSchedule, width: int) -> str:
    return f"""auto read_biases = [&](int layer, int j) {{ float2 v;  // of neurons 8 j + 2 t and the next
    asm volatile("ld.shared.v2.f32 {{%0,%1}},[%2];" : "=f"(v.x), "=f"(v.y)
        : "r"(weights + {schedule.biases} + {4 * width} * layer + 32 * j + 8 * t));
    return v; }};
"""


def save_results(schedule: HopperSchedule, z: str, tile: str) -> str:
    """A tile's accumulators `z` of the last layer, and its biases, to the spare slot; `tile` begins its first row."""
    return f"""UNROLL for (int j = 0; j < {schedule.layers[-1].layout.n_pad // 8}; ++j) {{
    const float2 bias = read_biases({len(schedule.layers) - 1}, j);
    const unsigned swizzled = area + {schedule.spare} + ((2 * j + (t >> 1) ^ g) << 4) + (t & 1u) * 8;
    UNROLL for (int h = 0; h < 2; ++h) asm volatile("st.shared.v2.f32 [%0],{{%1,%2}};"
        :: "r"(swizzled + ({tile}first + g + 8 * h) * {ROW}), "f"({z}[4 * j + 2 * h] + bias.x),
           "f"({z}[4 * j + 2 * h + 1] + bias.y) : "memory");
}}
"""


def read_results(schedule: HopperSchedule) -> str:
    """`return` those of this thread's sample."""
    n_out = schedule.layers[-1].layout.n
    text = f"__syncwarp();\nwp::vec_t<{n_out}, real> result;\n"
    for n in range(0, n_out, 4):
        text += f"{{ unsigned v[4]; load_unit(unit({schedule.spare}, {n // 4}), v);\n"
        text += "".join(f"result.c[{i}] = __uint_as_float(v[{i % 4}]);\n" for i in range(n, min(n + 4, n_out))) + "}\n"
    return text + "__syncwarp();\nreturn result;\n"


def input_word(n_in: int, k: int, halves: bool) -> str:
    """Elements k and k + 1 of x, as one register."""
    if halves:
        low, high = (f"static_cast<unsigned>(x.c[{i}].u)" if i < n_in else "0u" for i in (k, k + 1))
        return f"{low} | {high} << 16"
    low, high = (f"static_cast<real>(x.c[{i}])" if i < n_in else "0.0f" for i in (k, k + 1))
    return f"pack({low}, {high})"


def products(schedule: Hopper64Schedule, index: int) -> str:
    """Layer `index` of tile m, under way as a group."""
    layer = schedule.layers[index]
    multiply = "multiply_last(z[m]" if layer.last else "multiply_hidden(d[m]"
    return f"""begin_products();
UNROLL for (int b = 0; b < {layer.layout.k_pad // 16}; ++b)
    {multiply}, a[m][b], tile(weights + {layer.weights} + 32 * b, 0u), b);
commit();
"""


def activate(spec: NetworkSpec, schedule: Hopper64Schedule, index: int) -> str:
    """Results of layer `index` become the input of the next, whose products begin."""
    values = "d[m][4 * j + 2 * h] + biases[j].x", "d[m][4 * j + 2 * h + 1] + biases[j].y"
    if spec.activation is relu:
        word = "pack_relu({}, {})"
    else:
        word = "pack({}, {})" if spec.activation is linear else "pack(hidden({}), hidden({}))"
    return f"""{{ float2 biases[{WIDTH // 8}];
UNROLL for (int j = 0; j < {WIDTH // 8}; ++j) biases[j] = read_biases({index}, j);
UNROLL for (int m = 0; m < 2; ++m) {{
{wait(1, "d[m]")}
UNROLL for (int j = 0; j < {WIDTH // 8}; ++j)
UNROLL for (int h = 0; h < 2; ++h) a[m][j / 2][j % 2 * 2 + h] = {word.format(*values)};
{products(schedule, index + 1)}
UNROLL for (int b = 0; b < {WIDTH // 16}; ++b) save(matrices({(index + 1) * SLOT}, m, b), a[m][b]);
}} }}
"""
