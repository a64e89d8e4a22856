// `add(place, values...)`, `add2`, `add4`: to float32 memory, at an address aligned to as many floats; on the CPU one
// thread adds alone. Names: real. CUDA's atomicAdd takes generic addresses, for which the compiler also generates a
// loop over shared memory.

#if defined(__CUDA_ARCH__)
auto add = [](real* a, real x) { asm volatile("red.global.add.f32 [%0],%1;" ::"l"(a), "f"(x) : "memory"); };
auto add2 = [&](real* a, real x, real y) {
#if __CUDA_ARCH__ >= 900
    asm volatile("red.global.add.v2.f32 [%0],{%1,%2};" ::"l"(a), "f"(x), "f"(y) : "memory");
#else
    add(a, x);
    add(a + 1, y);
#endif
};
auto add4 = [&](real* a, real x, real y, real z, real w) {
#if __CUDA_ARCH__ >= 900
    asm volatile("red.global.add.v4.f32 [%0],{%1,%2,%3,%4};" ::"l"(a), "f"(x), "f"(y), "f"(z), "f"(w) : "memory");
#else
    add2(a, x, y);
    add2(a + 2, z, w);
#endif
};
#else
auto add = [](real* a, real x) { *a += x; };
auto add2 = [](real* a, real x, real y) {
    a[0] += x;
    a[1] += y;
};
auto add4 = [](real* a, real x, real y, real z, real w) {
    a[0] += x;
    a[1] += y;
    a[2] += z;
    a[3] += w;
};
#endif
