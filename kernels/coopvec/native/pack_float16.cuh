// Pairs of float16. Names: real, halves.cuh.

auto pack = half_pack;
auto low = half_low;
auto high = half_high;
auto pack_relu = [](real low, real high) {
    unsigned r;
    asm("cvt.rn.relu.f16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low));
    return r;
};
