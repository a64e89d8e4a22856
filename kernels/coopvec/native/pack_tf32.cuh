// One TF32 value, ties away from zero as `cvt.rna` has it. Names: real.

auto pack = [](real x) {
    unsigned r;
    asm("cvt.rna.tf32.f32 %0,%1;" : "=r"(r) : "f"(x));
    return r;
};
