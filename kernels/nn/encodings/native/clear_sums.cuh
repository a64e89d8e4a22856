// Clears the block's N sums in `memory`, WIDTH at a time. Whole blocks.

for (int k = threadIdx.x * WIDTH; k < N; k += blockDim.x * WIDTH)
    for (int c = 0; c < WIDTH; ++c) memory.data.ptr[k + c] = 0.0f;
__syncthreads();
