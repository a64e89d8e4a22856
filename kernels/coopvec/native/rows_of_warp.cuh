// Rows of memory, 16 at a time, to and from a warp's part of shared memory at `rows`: 16 rows of IN_UNITS
// times 16 bytes, in panels of 64 columns as the weights' are, then 16 rows of results.
// Constants: IN_UNITS, N_OUT of at most 16 results in a row.
// Names: lanes.cuh, matrices.cuh, rows, x, y.

constexpr unsigned INPUT_BYTES = (IN_UNITS + 7) / 8 * 16 * 128;
const unsigned n = x.shape[0], upper = lane >> 4, place = lane & 15u, results = rows + INPUT_BYTES;
const size_t pitch = x.strides[0];
auto fetch = [&](unsigned first) {  // rows from `first` on, under way; the last row for those beyond
#pragma unroll
    for (unsigned i = 0; i < IN_UNITS / 2; ++i) {
        const unsigned r = (32 * i + lane) / IN_UNITS, u = (32 * i + lane) % IN_UNITS;
        const unsigned to = rows + u / 8 * (16 * 128) + r * 128 + ((u % 8 ^ r % 8) << 4);
        const char* const from = reinterpret_cast<const char*>(x.data) + min(first + r, n - 1) * pitch + 16 * u;
        asm volatile("cp.async.cg.shared.global.L2::128B [%0],[%1],16;" ::"r"(to), "l"(from) : "memory");
    }
};
auto take = [&](int b, unsigned (&w)[4]) {  // columns 16 b on, as an A operand
    load(rows + b / 4 * (16 * 128) + place * 128 + (((b % 4 * 2 + upper) ^ (lane & 7u)) << 4), w);
};
auto leave = [&](unsigned first, const unsigned (&w)[4]) {  // accumulators as pairs of halves, to rows from `first` on
    const unsigned r = lane >> 1, u = lane & 1u;
    unsigned v[4];
    save(results + place * 32 + ((upper ^ (lane >> 2 & 1u)) << 4), w);
    __syncwarp();
    load_unit(results + r * 32 + ((u ^ (r >> 2 & 1u)) << 4), v);
    __syncwarp();
    if (first + r < n) {
        wp::half* const to = y.data + static_cast<size_t>(first + r) * N_OUT + 8 * u;
        if (N_OUT % 8 == 0) {
            if (8 * u < N_OUT) *reinterpret_cast<uint4*>(to) = make_uint4(v[0], v[1], v[2], v[3]);
        } else {
#pragma unroll
            for (unsigned i = 0; i < 8; ++i)
                if (8 * u + i < N_OUT) to[i].u = static_cast<unsigned short>(v[i / 2] >> 16 * (i % 2));
        }
    }
};
