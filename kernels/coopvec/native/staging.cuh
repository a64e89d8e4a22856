// Rows of a warp's 32 samples pass through its part of the pool, UNITS 16-byte units of each at a time, swizzled so
// that no two of eight lanes meet in a bank. Constants: ROW_UNITS, a power of two. Names: lanes.cuh, CHUNK, own_pool.

constexpr int UNITS = ROW_UNITS < CHUNK ? ROW_UNITS : CHUNK;  // 16-byte units of a row staged at a time
uint4* const own = own_pool + lane * UNITS;
auto swizzled = [](unsigned row) { return UNITS == 8 ? row & 7u : UNITS == 4 ? row >> 1 & 3u : row >> 2 & 1u; };
const unsigned swizzle = swizzled(lane);
const unsigned rows = static_cast<unsigned>(__cvta_generic_to_shared(own_pool));
auto scatter = [&](int unit, unsigned (&w)[4]) {  // word t of `unit` of rows 8 i + g, to the rows' own lanes
#if __CUDA_ARCH__ >= 900
    const unsigned address = rows + (lane * UNITS + (unit % UNITS ^ swizzle)) * 16;
    asm volatile("stmatrix.sync.aligned.m8n8.x4.shared.b16 [%0],{%1,%2,%3,%4};" ::"r"(address), "r"(w[0]), "r"(w[1]),
                 "r"(w[2]), "r"(w[3])
                 : "memory");
#else
#pragma unroll
    for (int i = 0; i < 4; ++i) {
        const unsigned row = 8 * i + g;
        uint4* place = own + (row - lane) * UNITS + (unit % UNITS ^ swizzled(row));
        reinterpret_cast<unsigned*>(place)[t] = w[i];
    }
#endif
};
auto gather = [&](int m, int b, unsigned (&w)[4]) {  // K block b of tile m as its A operand
    const unsigned row = 16 * m + (lane & 15u), unit = (2 * b + (lane >> 4)) % UNITS;
    const unsigned address = rows + (row * UNITS + (unit ^ swizzled(row))) * 16;
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3},[%4];"
                 : "=r"(w[0]), "=r"(w[1]), "=r"(w[2]), "=r"(w[3])
                 : "r"(address)
                 : "memory");
};
