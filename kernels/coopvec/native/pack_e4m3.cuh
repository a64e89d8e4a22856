// Four e4m3 values; `pack_relu` of float16 accumulators: times 2^-8 a half's exponent field is that of e4m3, ties round
// up. Names: real.

auto pack = [](real a, real b, real c, real d) {
    unsigned short u, v;
    asm("cvt.rn.satfinite.e4m3x2.f32 %0,%1,%2;" : "=h"(u) : "f"(b), "f"(a));
    asm("cvt.rn.satfinite.e4m3x2.f32 %0,%1,%2;" : "=h"(v) : "f"(d), "f"(c));
    return static_cast<unsigned>(u) | static_cast<unsigned>(v) << 16;
};
auto relu_byte = [](unsigned v) {
    unsigned r;
    asm("fma.rn.relu.f16x2 %0,%1,%2,%3; min.f16x2 %0,%0,%4;"
        : "=&r"(r)
        : "r"(v), "r"(0x1c001c00u), "r"(0u), "r"(0x3f003f00u));
    return r + r + 0x00800080u;
};
auto pack_relu = [&](unsigned a, unsigned b) { return __byte_perm(relu_byte(a), relu_byte(b), 0x7531); };
