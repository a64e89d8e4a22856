// What `leave_last.cuh` left, added up: the biases to BIAS_FIRST on of the block's sums, the loss to FLOATS.
// Constants besides: BASE and N of leave_last.cuh. Names: put.

if (threadIdx.x <= N) {
    all = 0.0f;
#pragma unroll
    for (int i = 0; i < 16; ++i) all += total[BASE + threadIdx.x * 16u + i];
    put(threadIdx.x < N ? BIAS_FIRST + threadIdx.x : FLOATS, all);
}
