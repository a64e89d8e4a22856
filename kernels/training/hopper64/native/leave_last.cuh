// To shared memory from BASE on: N biases of the last layer, as `start.cuh` dealt them to register BIAS_SUMS, and the
// losses, two floats a warp each. Names: finish.cuh.

real all = loss;
#pragma unroll
for (int bit = 16; bit > 1; bit /= 2) all += __shfl_xor_sync(0xffffffffu, all, bit);
if (lane / 2u < N) total[BASE + lane / 2u * 16u + 2u * warp + lane % 2u] = sums.c[BIAS_SUMS];
if (lane < 2u) total[BASE + 16 * N + 2u * warp + lane] = all;
