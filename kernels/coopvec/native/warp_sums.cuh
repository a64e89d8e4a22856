// Gradients of a whole warp's samples: lane l adds up column l of 32, to add it to memory once instead of 32 times.
// `together`: all lanes have one network with a gradient. Names: real, gradient.

struct Sums {
    static __device__ __noinline__ void of(const real* h, const real* dz, int k, int n, real* weights, real* biases) {
        // a local struct does not see the lambdas around it
        auto add = [](real* p, real v) { asm volatile("red.global.add.f32 [%0],%1;" ::"l"(p), "f"(v) : "memory"); };
        const int lane = threadIdx.x & 31;
        for (int first = 0; first < k; first += 32) {
            real v[32];  // this lane's sample; then of sample i, transposed
#pragma unroll
            for (int i = 0; i < 32; ++i) v[i] = first + i < k ? h[first + i] : 0.0f;
#pragma unroll
            for (int bit = 16; bit > 0; bit /= 2)
#pragma unroll
                for (int i = 0; i < 32; ++i)
                    if (!(i & bit)) {
                        const bool high = lane & bit;
                        const real other = __shfl_xor_sync(0xffffffffu, high ? v[i] : v[i | bit], bit);
                        if (high)
                            v[i] = other;
                        else
                            v[i | bit] = other;
                    }
            for (int row = 0; row < n; ++row) {
                const real mine = dz[row];
                real w = 0.0f, b = 0.0f;
#pragma unroll
                for (int i = 0; i < 32; ++i) {
                    const real d = __shfl_sync(0xffffffffu, mine, i);
                    w = fmaf(d, v[i], w);
                    b += d;
                }
                if (first + lane < k) add(weights + row * k + first + lane, w);
                if (first + lane == 0) add(biases + row, b);
            }
        }
    }
};
bool together = __activemask() == 0xffffffffu;
if (together) {
    const size_t mine = reinterpret_cast<size_t>(gradient), first = __shfl_sync(0xffffffffu, mine, 0);
    together = __all_sync(0xffffffffu, mine == first) && gradient;
}
