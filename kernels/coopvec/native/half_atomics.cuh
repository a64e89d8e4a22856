// `add_half(place, x)`, `add_half2(place, x, y)`: to float16 memory, x and y rounded first, each sum to nearest even.
// CUDA adds pairs in one instruction, single halves in a loop of its own: so their neighbour in the word gets -0, which
// changes no number. On the CPU one thread adds alone. Names: real.

#if defined(__CUDA_ARCH__)
auto add_word = [](size_t word, unsigned pair) {
    asm volatile("red.global.add.noftz.f16x2 [%0],%1;" ::"l"(word), "r"(pair) : "memory");
};
auto add_half = [&](wp::half* a, real x) {
    const size_t place = reinterpret_cast<size_t>(a);
    const unsigned bits = wp::float_to_half(x).u;
    add_word(place & ~size_t(3), place & 2u ? bits << 16 | 0x8000u : bits | 0x80000000u);
};
auto add_half2 = [&](wp::half* a, real x, real y) {
    const size_t place = reinterpret_cast<size_t>(a);
    if (place & 2u) {
        add_half(a, x);
        add_half(a + 1, y);
    } else
        add_word(place, wp::float_to_half(x).u | static_cast<unsigned>(wp::float_to_half(y).u) << 16);
};
#else
auto add_half = [](wp::half* a, real x) { *a += wp::half(x); };
#endif
