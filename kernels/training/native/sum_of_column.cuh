// The first warp of a block returns the sum of `column` over all rows of `partial`, which ADDERS more warps read: each
// thread HELD floats at a time. A warp has COLUMNS, 32, of them.

#if defined(__CUDA_ARCH__)
using real = wp::float32;
__shared__ real sums[COLUMNS * ADDERS];
const unsigned lane = threadIdx.x % 32u, blocks = partial.shape[0], count = partial.shape[1];
real total = 0.0f;
if (threadIdx.x >= 32u) {
    for (unsigned from = threadIdx.x / 32u - 1u; from < blocks; from += ADDERS * HELD) {
        real held[HELD];
#pragma unroll
        for (unsigned i = 0; i < HELD; ++i) {
            const unsigned b = from + i * ADDERS;
            held[i] = b < blocks && column < count ? partial.data[b * count + column] : 0.0f;
        }
#pragma unroll
        for (unsigned i = 0; i < HELD; ++i) total += held[i];
    }
    sums[threadIdx.x - 32u] = total;
}
__syncthreads();
if (threadIdx.x < 32u)
    for (unsigned w = 0; w < ADDERS; ++w) total += sums[w * COLUMNS + lane];
return total;
#else
return 0.0f;
#endif
