"""Conversion between float and the bits of each number format; round to nearest even, as the hardware's `cvt.rn`."""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import BFLOAT16, E4M3, E5M2, FLOAT16, FLOAT32, INT8, TF32, Format

BITS = "unsigned b; memcpy(&b, &x, 4);"
VALUE = "wp::float32 v; memcpy(&v, &b, 4); return v;"
SMALL_FLOATS = {
    E4M3: {"MANTISSA": 3, "MIN_EXPONENT": -6, "LARGEST": 448.0},
    E5M2: {"MANTISSA": 2, "MIN_EXPONENT": -14, "LARGEST": 57344.0},
}

ENCODE = {
    FLOAT32: f"{BITS} return b;",
    TF32: f"{BITS} return x == x ? (b + 0x1000u) & 0xffffe000u : 0x7fffffffu;",  # cvt.rna: ties away from zero
    FLOAT16: "return wp::float_to_half(x).u;",
    BFLOAT16: f"{BITS} return x == x ? (b + 0x7fffu + (b >> 16 & 1u)) >> 16 : 0x7fffu;",
    INT8: "return static_cast<unsigned>(static_cast<int>(wp::rint(wp::clamp(x, -128.0f, 127.0f)))) & 0xffu;",
}
for format, constants in SMALL_FLOATS.items():
    ENCODE[format] = paste(NATIVE / "encode_small_float.h", **constants) + "return encode_small_float(x);"

HALF = "wp::half h; h.u = static_cast<unsigned short>({}); "
DECODE = {
    FLOAT32: VALUE,
    TF32: VALUE,
    FLOAT16: HALF.format("b") + "return wp::half_to_float(h);",
    BFLOAT16: f"b = b << 16; {VALUE}",
    # the exponent field of a half, 8 too small: exact also for subnormal numbers
    E4M3: HALF.format("(b & 0x80u) << 8 | (b & 0x7fu) << ((b & 0x7fu) == 0x7fu ? 8 : 7)")
    + "return 256.0f * wp::half_to_float(h);",
    E5M2: HALF.format("b << 8") + "return wp::half_to_float(h);",
    INT8: "return static_cast<wp::float32>(static_cast<signed char>(b));",
}


@cache
def make_encode(format: Format):
    """`(x: float) -> uint32`, the bits of x in `format` in the low bits."""

    @wp.func_native(ENCODE[format])
    def encode(x: float) -> wp.uint32: ...

    return encode


@cache
def make_decode(format: Format):
    """`(b: uint32) -> float`, the value of bits in `format`."""

    @wp.func_native(DECODE[format])
    def decode(b: wp.uint32) -> float: ...

    return decode
