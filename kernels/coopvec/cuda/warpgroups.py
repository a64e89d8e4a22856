"""CUDA text of products by warpgroups (`wgmma`, sm_90a): the instruction, and its weights in shared memory.

Weights lie in panels of 64 columns, rows of 128 bytes, whose 16-byte units are swizzled by the row's low three bits: a
layout that both operands of `wgmma` can be read from (PTX ISA, matrix descriptors, 128-byte swizzling).
"""

from collections.abc import Sequence
from typing import Literal, Protocol

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.cuda.primitives import MMA_TYPES
from warp_neural.kernels.coopvec.fragment_layout import Text, operands
from warp_neural.kernels.coopvec.layout import LayerLayout, bias_is_half, bias_layout, network_layout
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import NetworkSpec, round_up

ROW = 128  # bytes of a row of a panel
MOST_HELD = 32  # registers of a thread that are read before any is stored
PRODUCTS = paste(NATIVE / "products.cuh")


class StagedLayer(Protocol):
    """weights: where they begin in shared memory, in bytes."""

    layout: LayerLayout
    weights: int


def panel_of(layout: LayerLayout) -> int:
    """Bytes of 64 columns."""
    return round_up(layout.n_pad, 16) * ROW


def panels_of(layout: LayerLayout) -> int:
    return -(-layout.k_pad // 64)


def wgmma(
    name: str,
    spec: NetworkSpec,
    n: int,
    a: Literal["registers", "rows", "columns"],
    transposed: bool,
    halves: bool = False,
) -> str:
    """A lambda `name(d, a, b, keep)`: d = a b, plus d if `keep`, of 64 x `n`. a: in "registers", four of them, or the
    descriptor of a matrix in shared memory by "rows" or "columns". transposed: b is by columns. halves: d is float16,
    two columns in a register."""
    element = MMA_TYPES[spec.format][1]
    sums, c_type, constraint, count = ("f16", "unsigned", "r", n // 4) if halves else ("f32", "real", "f", n // 2)
    results = ",".join(f"%{i}" for i in range(count))
    outputs = ", ".join(f'"+{constraint}"(d[{i}])' for i in range(count))
    if a == "registers":
        kind, inputs = "const unsigned (&a)[4]", ", ".join(f'"r"(a[{r}])' for r in range(4))
        source, b, turns = "{" + ",".join(f"%{count + r}" for r in range(4)) + "}", count + 4, f"{transposed:d}"
    else:
        kind, inputs, source, b = "Tile a", '"l"(a)', f"%{count}", count + 1
        turns = f"{a == 'columns':d}, {transposed:d}"
    shape = f"m64n{n}k16.{sums}.{element}.{element}"
    return f"""auto {name} = []({c_type} (&d)[{count}], {kind}, Tile b, int keep) {{
asm volatile("{{.reg .pred p; setp.ne.b32 p, %{b + 1}, 0;\\n"
    "wgmma.mma_async.sync.aligned.{shape} {{{results}}}, {source}, %{b}, p, 1, 1, {turns};}}"
    : {outputs} : {inputs}, "l"(b), "r"(keep) : "memory"); }};
"""


def wait(pending: int, *registers: str, constraint: str = "f") -> str:
    """Until at most so many groups of products are under way; `registers`: arrays that are ready then."""
    text = f'asm volatile("wgmma.wait_group.sync.aligned {pending};" ::: "memory");\n'
    for name in registers:
        text += f"UNROLL for (int r = 0; r < sizeof({name}) / 4; ++r) "
        text += f'asm volatile("" : "+{constraint}"(({name})[r]) :: "memory");\n'
    return text


def stage_weights(spec: NetworkSpec, layers: Sequence[StagedLayer], threads: int, biases: int | None = None) -> str:
    """By all threads of a block, to `shared`, the first multiple of 1024 bytes in `memory`: the weights and, from
    `biases` on, the biases as float32. Names: params, memory; those of `prelude`."""
    _, words = network_layout(spec, True)
    row, unit, word, column = staged_place(spec)
    return f"""const unsigned* const mine = params.packed.data + static_cast<size_t>(params.network) * {words};
char* const unaligned = reinterpret_cast<char*>(memory.data.ptr);
char* const shared = unaligned + (-static_cast<unsigned>(__cvta_generic_to_shared(unaligned)) & 1023u);
real* const biases = reinterpret_cast<real*>(shared + {biases or 0});
const uint4 zero = make_uint4(0u, 0u, 0u, 0u);
auto store = [&](uint4 v, unsigned i, unsigned k_pad, unsigned weights, unsigned panel) {{
    const unsigned words[4] = {{v.x, v.y, v.z, v.w}};
    const unsigned unit = {unit}, swizzle = unit % 8 ^ g;
    char* const row = shared + weights + unit / 8 * panel + {row} * {ROW} + 2 * {column};
    UNROLL for (int r = 0; r < 4; ++r) *reinterpret_cast<unsigned*>(row + ((swizzle ^ {word}) << 4)) = words[r];
}};
const unsigned n = threadIdx.x;
{copies(spec, layers, threads, biases is not None)}"""


PUBLISH = 'asm volatile("fence.proxy.async.shared::cta;" ::: "memory");\n__syncthreads();\n'


def copies(spec: NetworkSpec, layers: Sequence[StagedLayer], threads: int, biases: bool) -> str:
    """Of all layers: as many reads as registers hold, then what is read is stored."""
    text = reads = stores = ""
    width, held = spec.sizes[1], 0
    for index, layer in enumerate(layers):
        layout, panel = layer.layout, panel_of(layer.layout)
        units = layout.operands(spec.format).elements // 8
        for start in range(0, units, threads):
            name, inside = f"v_{index}_{start}", f"if (threadIdx.x < {units - start}u) "
            inside = "" if units - start >= threads else inside
            source = f"__ldg(reinterpret_cast<const uint4*>(mine + {layout.weights}) + {start} + threadIdx.x)"
            reads += f"uint4 {name}; {inside}{name} = {source};\n"
            stores += f"{inside}store({name}, {start} + threadIdx.x, {layout.k_pad}, {layer.weights}, {panel});\n"
            held += 4
        if biases:
            reads += f"const real bias_{index} = threadIdx.x < {layout.n_pad}u ? {bias_value(spec, layout)} : 0.0f;\n"
            stores += f"if (threadIdx.x < {width}u) biases[{width * index} + threadIdx.x] = bias_{index};\n"
        if layout.n_pad % 16:
            for p in range(panels_of(layout)):
                place = layer.weights + p * panel + layout.n_pad * ROW
                stores += f"if (threadIdx.x < 64u) reinterpret_cast<uint4*>(shared + {place})[threadIdx.x] = zero;\n"
        if held >= MOST_HELD or layer is layers[-1]:
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
