// Pairs of float16 in 32-bit registers. Names: real.

auto half_pack = [](real low, real high) {
    unsigned r;
    asm("cvt.rn.f16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low));
    return r;
};
auto half_low = [](unsigned v) {
    real r;
    asm("{.reg .f16 l,h; mov.b32 {l,h},%1; cvt.f32.f16 %0,l;}" : "=f"(r) : "r"(v));
    return r;
};
auto half_high = [](unsigned v) {
    real r;
    asm("{.reg .f16 l,h; mov.b32 {l,h},%1; cvt.f32.f16 %0,h;}" : "=f"(r) : "r"(v));
    return r;
};
auto half_max = [](unsigned a, unsigned b) {
    unsigned r;
    asm("max.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(b));
    return r;
};
auto half_min = [](unsigned a, unsigned b) {
    unsigned r;
    asm("min.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(b));
    return r;
};
auto half_add_relu = [](unsigned a, unsigned b) {
    unsigned r;
    asm("fma.rn.relu.f16x2 %0,%1,%2,%3;" : "=r"(r) : "r"(a), "r"(0x3c003c00u), "r"(b));
    return r;
};
auto half_leak = [&](unsigned a) {  // times 0.01
    unsigned r;
    asm("mul.f16x2 %0,%1,%2;" : "=r"(r) : "r"(a), "r"(0x211f211fu));
    return half_max(a, r);
};
