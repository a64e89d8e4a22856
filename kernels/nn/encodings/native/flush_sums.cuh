// Adds the block's N sums, but for groups of WIDTH zeros, to the gradient from `grad` on. Whole blocks.
// Names: real, atomics.cuh.

const real* const sums = memory.data.ptr;
__syncthreads();
for (int k = threadIdx.x * WIDTH; k < N; k += blockDim.x * WIDTH) {
    bool any = false;
    for (int c = 0; c < WIDTH; ++c) any |= sums[k + c] != 0.0f;
    if (!any) continue;
    if (WIDTH == 4) add4(grad + k, sums[k], sums[k + 1], sums[k + 2], sums[k + 3]);
    if (WIDTH == 2) add2(grad + k, sums[k], sums[k + 1]);
    if (WIDTH == 1) add(grad + k, sums[k]);
}
