"""CUDA text of the primitives: lanes, staging in shared memory, conversion to registers of each format, `mma.sync`."""

import warp as wp

from warp_neural.kernels.coopvec.layout import network_layout
from warp_neural.kernels.coopvec.pool import OWN
from warp_neural.kernels.nn.spec import BFLOAT16, E4M3, E5M2, FLOAT16, INT8, TF32, Format, NetworkSpec

MMA_TYPES = {
    FLOAT16: ("m16n8k16", "f16"),
    BFLOAT16: ("m16n8k16", "bf16"),
    TF32: ("m16n8k8", "tf32"),
    E4M3: ("m16n8k32", "e4m3"),
    E5M2: ("m16n8k32", "e5m2"),
    INT8: ("m16n8k32", "s8"),
}


def accumulator(spec: NetworkSpec) -> tuple[str, int]:
    """C++ type and count of one tile's accumulator registers."""
    if spec.format is INT8:
        return "integer", 4
    return ("unsigned", 2) if spec.accumulation == "float16" else ("real", 4)


def stage(spec: NetworkSpec) -> str:
    """The shared memory that vectors pass through; needs the lanes of `prelude`."""
    return STAGE.replace("ROW_UNITS", str(row_units(spec)))


def row_units(spec: NetworkSpec) -> int:
    """16-byte units of the longer of input and output row, rounded up to a power of two."""
    layers, _ = network_layout(spec, True)
    output_bits = 16 if packs_halves(spec) else 32
    units = max(layers[0].k_pad * spec.format.bits, layers[-1].n_pad * output_bits) // 128
    return 1 << (units - 1).bit_length()


def mma(name: str, format: Format, accumulator_type: str) -> str:
    """A lambda `name(d, c, a, b0, b1)`: d = c + a b on one 16 x 8 tile."""
    shape, element = MMA_TYPES[format]
    result, count, constraint = {"unsigned": ("f16", 2, "r"), "real": ("f32", 4, "f"), "integer": ("s32", 4, "r")}[
        accumulator_type
    ]

    def operands(first, number):
        return "{" + ",".join(f"%{i}" for i in range(first, first + number)) + "}"

    outputs = ", ".join(f'"={constraint}"(d[{i}])' for i in range(count))
    inputs = ", ".join([f'"r"(a[{i}])' for i in range(4)] + ['"r"(b0)', '"r"(b1)'])
    inputs += "".join(f', "{constraint}"(c[{i}])' for i in range(count))
    types = f"{accumulator_type} (&d)[{count}], const {accumulator_type} (&c)[{count}]"
    return f"""auto {name} = []({types}, const unsigned (&a)[4], unsigned b0, unsigned b1) {{
asm("mma.sync.aligned.{shape}.row.col.{result}.{element}.{element}.{result} "
    "{operands(0, count)},{operands(count, 4)},{operands(count + 4, 2)},{operands(count + 6, count)};"
    : {outputs} : {inputs}); }};
"""


LANES = """using real = wp::float32; using integer = wp::int32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u;
"""
STAGE = (
    OWN
    + """
constexpr int UNITS = ROW_UNITS < CHUNK ? ROW_UNITS : CHUNK;  // 16-byte units of a row staged at a time
uint4* const own = own_pool + lane * UNITS;
auto swizzled = [](unsigned row) { return UNITS == 8 ? row & 7u : UNITS == 4 ? row >> 1 & 3u : row >> 2 & 1u; };
const unsigned swizzle = swizzled(lane);
const unsigned rows = static_cast<unsigned>(__cvta_generic_to_shared(own_pool));
auto scatter = [&](int unit, unsigned (&w)[4]) {  // word t of `unit` of rows 8 i + g, to the rows' own lanes
#if __CUDA_ARCH__ >= 900
    const unsigned address = rows + (lane * UNITS + (unit % UNITS ^ swizzle)) * 16;
    asm volatile("stmatrix.sync.aligned.m8n8.x4.shared.b16 [%0],{%1,%2,%3,%4};"
        :: "r"(address), "r"(w[0]), "r"(w[1]), "r"(w[2]), "r"(w[3]) : "memory");
#else
#pragma unroll
    for (int i = 0; i < 4; ++i) {
        const unsigned row = 8 * i + g;
        uint4* place = own + (row - lane) * UNITS + (unit % UNITS ^ swizzled(row));
        reinterpret_cast<unsigned*>(place)[t] = w[i];
    }
#endif
};
auto gather = [&](int m, int b, unsigned (&w)[4]) {  // K block b of tile m as its A operand
    const unsigned row = 16 * m + (lane & 15u), unit = (2 * b + (lane >> 4)) % UNITS;
    const unsigned address = rows + (row * UNITS + (unit ^ swizzled(row))) * 16;
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3},[%4];"
        : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3]) : "r"(address) : "memory");
};
"""
)

# lambdas to and from registers of each format
HALF_TEXT = """
auto half_pack = [](real low, real high) { unsigned r;
    asm("cvt.rn.f16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low)); return r; };
auto half_low = [](unsigned v) { real r;
    asm("{.reg .f16 l,h; mov.b32 {l,h},%1; cvt.f32.f16 %0,l;}" : "=f"(r) : "r"(v)); return r; };
auto half_high = [](unsigned v) { real r;
    asm("{.reg .f16 l,h; mov.b32 {l,h},%1; cvt.f32.f16 %0,h;}" : "=f"(r) : "r"(v)); return r; };
auto half_max = [](unsigned a, unsigned b) { unsigned r;
    asm("max.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(b)); return r; };
auto half_min = [](unsigned a, unsigned b) { unsigned r;
    asm("min.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(b)); return r; };
auto half_add_relu = [](unsigned a, unsigned b) { unsigned r;
    asm("fma.rn.relu.f16x2 %0,%1,%2,%3;" : "=r"(r) : "r"(a), "r"(0x3c003c00u), "r"(b)); return r; };
auto half_leak = [&](unsigned a) { unsigned r;
    asm("mul.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(0x211f211fu)); return half_max(a, r); };  // 0.01
"""
PACK = {
    FLOAT16: """
auto pack = half_pack; auto low = half_low; auto high = half_high;
auto pack_relu = [](real low, real high) { unsigned r;
    asm("cvt.rn.relu.f16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low)); return r; };
""",
    BFLOAT16: """
auto low = [](unsigned v) { return __uint_as_float(v << 16); };
auto high = [](unsigned v) { return __uint_as_float(v & 0xffff0000u); };
auto pack = [](real low, real high) { unsigned r;
    asm("cvt.rn.bf16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low)); return r; };
auto pack_relu = [](real low, real high) { unsigned r;
    asm("cvt.rn.relu.bf16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low)); return r; };
""",
    TF32: """
auto pack = [](real x) { unsigned r; asm("cvt.rna.tf32.f32 %0,%1;" : "=r"(r) : "f"(x)); return r; };
""",
    # adding 1.5 * 2^23 rounds to an integer and leaves it in the low bits
    INT8: """
auto byte_of = [](real x) { return __float_as_uint(x + 12582912.0f); };
auto bytes_of = [](unsigned a, unsigned b, unsigned c, unsigned d) {
    return __byte_perm(__byte_perm(a, b, 0x0040), __byte_perm(c, d, 0x0040), 0x5410); };
auto clamped = [&](real x) { return byte_of(fminf(fmaxf(x, -127.0f), 127.0f)); };
auto pack = [&](real a, real b, real c, real d) { return bytes_of(clamped(a), clamped(b), clamped(c), clamped(d)); };
auto share = [&](real x) { return __float_as_uint(fmaf(x, 127.0f, 12582912.0f)); };
auto pack_share = [&](real a, real b, real c, real d) { return bytes_of(share(a), share(b), share(c), share(d)); };
""",
}
for fp8, pair in ((E4M3, "e4m3x2"), (E5M2, "e5m2x2")):
    PACK[fp8] = f"""
auto pack = [](real a, real b, real c, real d) {{ unsigned short u, v;
    asm("cvt.rn.satfinite.{pair}.f32 %0,%1,%2;" : "=h"(u) : "f"(b), "f"(a));
    asm("cvt.rn.satfinite.{pair}.f32 %0,%1,%2;" : "=h"(v) : "f"(d), "f"(c));
    return static_cast<unsigned>(u) | static_cast<unsigned>(v) << 16; }};
"""
# ReLU of float16 accumulators, faster than `cvt`: times 2^-8 a half's exponent field is that of e4m3; ties round up
PACK[E4M3] += """
auto relu_byte = [](unsigned v) { unsigned r;
    asm("fma.rn.relu.f16x2 %0,%1,%2,%3; min.f16x2 %0,%0,%4;"
        : "=&r"(r) : "r"(v), "r"(0x1c001c00u), "r"(0u), "r"(0x3f003f00u)); return r + r + 0x00800080u; };
auto pack_relu = [&](unsigned a, unsigned b) { return __byte_perm(relu_byte(a), relu_byte(b), 0x7531); };
"""
PACK[E5M2] += """
auto relu_byte = [&](unsigned v) { return half_min(half_max(v, 0u), 0x7b007b00u) + 0x00800080u; };
auto pack_relu = [&](unsigned a, unsigned b) { return __byte_perm(relu_byte(a), relu_byte(b), 0x7531); };
"""


def prelude(spec: NetworkSpec) -> str:
    """The lambdas that the rest of the text is made of."""
    text = LANES + HALF_TEXT + PACK[spec.format]
    text += mma("multiply", spec.format, accumulator(spec)[0])
    for name, activation in (("hidden", spec.activation), ("last", spec.output_activation)):
        text += f"auto {name} = [](real z) -> real {{ return {activation.value}; }};\n"
    return text


def packs_halves(spec: NetworkSpec) -> bool:
    """Whether results leave as pairs of float16."""
    return spec.accumulation == "float16" or spec.dtype is wp.float16
