// Adds up COUNT copies of SIZE floats, from COPIES on in shared memory, to the block's sums from FIRST on.
// Constants besides: THREADS of the block. Names: finish.cuh.

for (unsigned i = threadIdx.x; i < SIZE; i += THREADS) {
    real sum = add ? mine[FIRST + i] : 0.0f;
#pragma unroll
    for (int copy = 0; copy < COUNT; ++copy) sum += total[COPIES + copy * SIZE + i];
    mine[FIRST + i] = sum;
}
