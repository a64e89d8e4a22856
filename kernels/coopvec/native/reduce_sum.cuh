// The sum of a warp's vectors `v` of N elements, added to `target` once, where it arrives whole with one target.
// Names: real, add of atomics.cuh.

bool together = __activemask() == 0xffffffffu;
if (together) {
    const unsigned long long key = reinterpret_cast<unsigned long long>(target);
    together = __all_sync(0xffffffffu, key == __shfl_sync(0xffffffffu, key, 0));
}
if (together) {
    for (int i = 0; i < N; ++i) {
        real sum = static_cast<real>(v.c[i]);
        for (int bit = 16; bit > 0; bit /= 2) sum += __shfl_xor_sync(0xffffffffu, sum, bit);
        if ((threadIdx.x & 31u) == 0u) add(target + i, sum);
    }
    return;
}
