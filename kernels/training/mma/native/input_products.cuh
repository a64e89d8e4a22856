// dh = dz W of one layer, times the slopes of the layer before: that layer's dz, saved; `dz` stays in registers.
// Constants: N_BLOCKS, K_BLOCKS of 16 neurons and inputs, PAIRS of the latter, TILES of 8 neurons; in bytes WEIGHTS in
// shared memory, and in an area DZ, H and TARGET, where the results go; SLOPED, whether slopes depend on H.
// Names: places.cuh, multiply_add, `back_word(a, b, kept)`: both times the slopes at `kept`, as one register.

unsigned dz[2][N_BLOCKS][4];
#pragma unroll
for (int m = 0; m < 2; ++m)
#pragma unroll
    for (int b = 0; b < N_BLOCKS; ++b) load(area + DZ + (m * N_BLOCKS + b) * 512, dz[m][b]);
#pragma unroll
for (int p = 0; p < PAIRS; ++p) {
    real dh[2][4][4];
#pragma unroll
    for (int m = 0; m < 2; ++m)
#pragma unroll
        for (int j = 0; j < 4; ++j)
#pragma unroll
            for (int r = 0; r < 4; ++r) dh[m][j][r] = 0.0f;
#pragma unroll
    for (int nb = 0; nb < N_BLOCKS; ++nb) {
        unsigned w0[4], w1[4] = {0u, 0u, 0u, 0u};
        load_transposed(weights + WEIGHTS + (2 * nb * PAIRS + p) * 512, w0);
        if (2 * nb + 1 < TILES) load_transposed(weights + WEIGHTS + ((2 * nb + 1) * PAIRS + p) * 512, w1);
#pragma unroll
        for (int j = 0; j < 4; ++j)
            if (2 * p + j / 2 < K_BLOCKS)
#pragma unroll
                for (int m = 0; m < 2; ++m) multiply_add(dh[m][j], dh[m][j], dz[m][nb], w0[j], w1[j]);
    }
#pragma unroll
    for (int m = 0; m < 2; ++m)
#pragma unroll
        for (int b = 0; b < 2; ++b)
            if (2 * p + b < K_BLOCKS) {
                unsigned previous[4], kept[4] = {};
                if (SLOPED) load(area + H + (m * K_BLOCKS + 2 * p + b) * 512, kept);
#pragma unroll
                for (int r = 0; r < 4; ++r) {
                    const real(&pair)[4] = dh[m][2 * b + r / 2];
                    previous[r] = back_word(pair[r % 2 * 2], pair[r % 2 * 2 + 1], kept[r]);
                }
                save(area + TARGET + (m * K_BLOCKS + 2 * p + b) * 512, previous);
            }
}
