// A whole warp whose lanes load rows that follow each other: 16 bytes a lane in order of memory, dealt out through the
// pool. With a row a thread, every load would touch 32 lines of the cache. Sets `words` where `together` is true.
// Constants: UNITS of 16 bytes in a row, MOST of them that may pass at a time. Names: bytes, pitch, aligned, words,
// pool.

#if __CUDA_ARCH__ >= 800
const unsigned lane = threadIdx.x & 31u;
size_t first = 0;
bool together = __activemask() == 0xffffffffu;
if (together) {
    first = __shfl_sync(0xffffffffu, reinterpret_cast<size_t>(bytes), 0);
    together = __all_sync(0xffffffffu, aligned && reinterpret_cast<size_t>(bytes) == first + lane * pitch);
}
if (together) {
    constexpr int PASS = CHUNK < MOST ? CHUNK : MOST;
    auto place = [&](unsigned row, unsigned u) {  // swizzled: no two of eight lanes meet in a bank
        return own_pool + row * PASS + (u ^ (PASS == 8 ? row & 7u : PASS == 4 ? row >> 1 & 3u : row >> 2 & 1u));
    };
    const unsigned own = lane % PASS, above = lane / PASS;  // the unit of a chunk, and the row, that this lane moves
    auto source = [&](unsigned c, unsigned r) {
        return reinterpret_cast<const uint4*>(first + (32 / PASS * r + above) * pitch) + c + own;
    };
    auto inside = [&](unsigned c) { return c + PASS <= UNITS || c + own < UNITS; };
    constexpr bool AHEAD = PASS < UNITS;  // in several chunks: wait for memory once
    uint4 ahead[UNITS + PASS];
#pragma unroll
    for (unsigned c = 0; c < UNITS && AHEAD; c += PASS)
#pragma unroll
        for (unsigned r = 0; r < PASS; ++r)
            if (inside(c)) ahead[c + r] = __ldcg(source(c, r));
#pragma unroll
    for (unsigned c = 0; c < UNITS; c += PASS) {
#pragma unroll
        for (unsigned r = 0; r < PASS; ++r)
            if (inside(c)) {
                uint4* const target = place(32 / PASS * r + above, own);
                if (AHEAD)
                    *target = ahead[c + r];
                else
                    asm volatile("cp.async.cg.shared.global [%0],[%1],16;" ::"r"(
                                     static_cast<unsigned>(__cvta_generic_to_shared(target))),
                                 "l"(source(c, r))
                                 : "memory");
            }
        if (!AHEAD) asm volatile("cp.async.wait_all;" ::: "memory");
        __syncwarp();
#pragma unroll
        for (unsigned u = c; u < c + PASS && u < UNITS; ++u) {
            const uint4 q = *place(lane, u - c);
            words[4 * u] = q.x;
            words[4 * u + 1] = q.y;
            words[4 * u + 2] = q.z;
            words[4 * u + 3] = q.w;
        }
        __syncwarp();  // what a lane has read, another may overwrite
    }
}
#else
constexpr bool together = false;
#endif
