// To shared memory: a copy of a layer's gradient for each split, of its biases' for each group of columns too.
// Constants, see MmaLayer: TASKS, SPLITS, ROWS, COLUMNS, GROUPS, N_BLOCKS, K_BLOCKS, SUMS, BIAS_SUMS, COPIES,
// BIAS_COPIES; COLUMN of a product that has the biases. Names: finish.cuh.

if (warp < TASKS * SPLITS) {
    const unsigned task = warp % TASKS, split = warp / TASKS;
    const unsigned n0 = task / GROUPS * ROWS, b0 = task % GROUPS * COLUMNS;
#pragma unroll
    for (int i = 0; i < ROWS; ++i)
#pragma unroll
        for (int c = 0; c < COLUMNS; ++c)
#pragma unroll
            for (int side = 0; side < 2; ++side) {
                const real* const dw = sums.c + SUMS + ((i * COLUMNS + c) * 2 + side) * 4;
                const unsigned tile = ((n0 + i) * K_BLOCKS + b0 + c) * 2 + side;
                real* const copy = total + COPIES + split * (N_BLOCKS * K_BLOCKS * 256) + tile * 128;
                reinterpret_cast<float4*>(copy)[lane] = make_float4(dw[0], dw[1], dw[2], dw[3]);
            }
    if (t == COLUMN / 2)
#pragma unroll
        for (int i = 0; i < ROWS; ++i)
#pragma unroll
            for (int half = 0; half < 2; ++half)
                total[BIAS_COPIES + ((split * GROUPS + task % GROUPS) * N_BLOCKS + n0 + i) * 16 + half * 8 + g] =
                    sums.c[BIAS_SUMS + i * 4 + 2 * half + COLUMN % 2];
}
