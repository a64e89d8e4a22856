// The sum of a warp's vectors `v` of N elements, added to `target` once, where it arrives whole with one target; WIDTH
// elements at a time, 1 or 2, where they lie side by side. Names: real, add(place, x), add2(place, x, y), step, from
// element to element.

bool together = __activemask() == 0xffffffffu;
if (together) {
    const unsigned long long key = reinterpret_cast<unsigned long long>(target);
    together = __all_sync(0xffffffffu, key == __shfl_sync(0xffffffffu, key, 0));
}
if (together) {
    auto sum_of = [&](int i) {
        real sum = static_cast<real>(v.c[i]);
        for (int bit = 16; bit > 0; bit /= 2) sum += __shfl_xor_sync(0xffffffffu, sum, bit);
        return sum;
    };
    const bool first = (threadIdx.x & 31u) == 0u;
    int i = 0;
    for (; WIDTH == 2 && step == 1 && i + 1 < N; i += 2) {
        const real low = sum_of(i), high = sum_of(i + 1);
        if (first) add2(target + i, low, high);
    }
    for (; i < N; ++i) {
        const real sum = sum_of(i);
        if (first) add(target + i * step, sum);
    }
    return;
}
