// Pairs of bfloat16. Names: real.

auto low = [](unsigned v) { return __uint_as_float(v << 16); };
auto high = [](unsigned v) { return __uint_as_float(v & 0xffff0000u); };
auto pack = [](real low, real high) {
    unsigned r;
    asm("cvt.rn.bf16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low));
    return r;
};
auto pack_relu = [](real low, real high) {
    unsigned r;
    asm("cvt.rn.relu.bf16x2.f32 %0,%1,%2;" : "=r"(r) : "f"(high), "f"(low));
    return r;
};
