"""CUDA text of a fused training step by warpgroups: weights, biases and ones to shared memory.

Weights lie in panels of 64 columns, the rows of a panel swizzled as in slots (see `hopper64.forward`).
"""

from warp_neural.kernels.coopvec.cuda import primitives
from warp_neural.kernels.coopvec.fragment_layout import Text, operands
from warp_neural.kernels.coopvec.layout import LayerLayout, bias_is_half, bias_layout, network_layout
from warp_neural.kernels.nn.spec import NetworkSpec, round_up
from warp_neural.kernels.training.hopper64.schedule import ROW, HopperSchedule
from warp_neural.kernels.training.text import ones_of

MOST_HELD = 32  # registers of a thread that are read before any is stored


def begin_text(spec: NetworkSpec, schedule: HopperSchedule) -> str:
    """`(params, memory)`. All threads."""
    _, words = network_layout(spec, True)
    one = ", ".join([ones_of(spec)] * 4)
    row, unit, word, column = staged_place(spec)
    return f"""{primitives.prelude(spec)}
const unsigned* const mine = params.packed.data + static_cast<size_t>(params.network) * {words};
char* const unaligned = reinterpret_cast<char*>(memory.data.ptr);
char* const shared = unaligned + (-static_cast<unsigned>(__cvta_generic_to_shared(unaligned)) & 1023u);
real* const biases = reinterpret_cast<real*>(shared + {schedule.biases});
const uint4 zero = make_uint4(0u, 0u, 0u, 0u), one = make_uint4({one});
auto store = [&](uint4 v, unsigned i, unsigned k_pad, unsigned weights, unsigned panel) {{
    const unsigned words[4] = {{v.x, v.y, v.z, v.w}};
    const unsigned unit = {unit}, swizzle = unit % 8 ^ g;
    char* const row = shared + weights + unit / 8 * panel + {row} * {ROW} + 2 * {column};
    UNROLL for (int r = 0; r < 4; ++r) *reinterpret_cast<unsigned*>(row + ((swizzle ^ {word}) << 4)) = words[r];
}};
const unsigned n = threadIdx.x;
{copies(spec, schedule)}if (threadIdx.x < 128u) reinterpret_cast<uint4*>(shared + {schedule.ones})[threadIdx.x] = one;
asm volatile("fence.proxy.async.shared::cta;" ::: "memory");
__syncthreads();
"""


def copies(spec: NetworkSpec, schedule: HopperSchedule) -> str:
    """Of all layers: as many reads as registers hold, then what is read is stored."""
    text = reads = stores = ""
    width, held = spec.sizes[1], 0
    for index, layer in enumerate(schedule.layers):
        layout, panel = layer.layout, round_up(layer.layout.n_pad, 16) * ROW
        units = layout.operands(spec.format).elements // 8
        for start in range(0, units, schedule.threads):
            name, inside = f"v_{index}_{start}", f"if (threadIdx.x < {units - start}u) "
            inside = "" if units - start >= schedule.threads else inside
            source = f"__ldg(reinterpret_cast<const uint4*>(mine + {layout.weights}) + {start} + threadIdx.x)"
            reads += f"uint4 {name}; {inside}{name} = {source};\n"
            stores += f"{inside}store({name}, {start} + threadIdx.x, {layout.k_pad}, {layer.weights}, {panel});\n"
            held += 4
        reads += f"const real bias_{index} = threadIdx.x < {layout.n_pad}u ? {bias_value(spec, layout)} : 0.0f;\n"
        stores += f"if (threadIdx.x < {width}u) biases[{width * index} + threadIdx.x] = bias_{index};\n"
        if layout.n_pad % 16:
            for p in range(-(-layout.k_pad // 64)):
                place = layer.weights + p * panel + layout.n_pad * ROW
                stores += f"if (threadIdx.x < 64u) reinterpret_cast<uint4*>(shared + {place})[threadIdx.x] = zero;\n"
        if held >= MOST_HELD or layer is schedule.layers[-1]:
            text += reads + stores
            reads, stores, held = "", "", 0
    return text


def staged_place(spec: NetworkSpec) -> tuple[Text, ...]:
    """Of word `r` of the 16 bytes `i` of a layer's weights, which lane 4 g + t has: the row; the unit of eight columns,
    of the first word and how much further `r` is; the first column in it."""
    weights = operands(spec.format, Text("n_pad"), Text("k_pad"))
    rows, columns = weights.axes
    digits = weights.memory.only("t", "g", "pair", "tile").split(Text("i")) | {"t": Text("t"), "g": Text("g")}
    word = weights.memory.only("register", "half").split(Text("r"))
    units, inside = columns.only("register", "half", "pair"), columns.only("e", "t")
    return rows.join(**digits), units.join(**digits), units.join(**word), inside.join(**digits)


def bias_value(spec: NetworkSpec, layout: LayerLayout) -> str:
    """Of neuron n, from the packed buffer."""
    biases = bias_layout(spec, layout.n_pad)
    if bias_is_half(spec, True):
        pair = biases.memory.only("tile", "t", "rest").join(**biases.axes[0].split(Text("n")))
        word = f"mine[{layout.bias} + {pair}]"
        return f"(n % 2u ? half_high({word}) : half_low({word}))"
    return f"__uint_as_float(mine[{layout.bias} + {biases.index(Text('n'))}])"
