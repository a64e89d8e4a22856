// Four e5m2 values; `pack_relu` of float16 accumulators, ties round up. Names: real, halves.cuh.

auto pack = [](real a, real b, real c, real d) {
    unsigned short u, v;
    asm("cvt.rn.satfinite.e5m2x2.f32 %0,%1,%2;" : "=h"(u) : "f"(b), "f"(a));
    asm("cvt.rn.satfinite.e5m2x2.f32 %0,%1,%2;" : "=h"(v) : "f"(d), "f"(c));
    return static_cast<unsigned>(u) | static_cast<unsigned>(v) << 16;
};
auto relu_byte = [&](unsigned v) { return half_min(half_max(v, 0u), 0x7b007b00u) + 0x00800080u; };
auto pack_relu = [&](unsigned a, unsigned b) { return __byte_perm(relu_byte(a), relu_byte(b), 0x7531); };
