// Adds this warp's units of dZ^T H, over its split of the block's samples, to `sum`, loading one step ahead.
//
// Constants, see MmaLayer: TASKS, SPLITS, ROWS, COLUMNS, GROUPS of columns, N_BLOCKS, K_BLOCKS, SUMS, BIAS_SUMS; WARPS;
// in bytes DZ, H in an area and its length AREA; COLUMN of a product in which the layer's biases meet those of others.
// PRE_ACTIVATIONS: H holds those, which are still to be activated.
// Warps of different columns start at different samples, so that each adds the biases of others of them.
// Names: places.cuh, pack and so on of the format, multiply_add, hidden.

constexpr int SAMPLES = WARPS / SPLITS;  // in 32s
constexpr bool SHARED_BIAS = SAMPLES % GROUPS == 0;
if (TASKS * SPLITS == WARPS || warp < TASKS * SPLITS) {
    const unsigned task = warp % TASKS, split = warp / TASKS, turn = task % GROUPS;
    const unsigned one = g == COLUMN && (SHARED_BIAS || turn == 0) ? ones : 0u;
    const unsigned rows_of = areas + DZ + task / GROUPS * (ROWS * 512) - lane * 16 + turned;
    const unsigned columns_of = areas + H + turn * (COLUMNS * 512);
    unsigned d[2][ROWS][4], h[2][COLUMNS][4];
    auto fetch = [&](int i, unsigned (&d)[ROWS][4], unsigned (&h)[COLUMNS][4]) {
        const unsigned s = (split * SAMPLES + (i / 2 + turn) % SAMPLES) * AREA, m = i % 2;
#pragma unroll
        for (int row = 0; row < ROWS; ++row) load_transposed(rows_of + s + (m * N_BLOCKS + row) * 512, d[row]);
#pragma unroll
        for (int c = 0; c < COLUMNS; ++c) load_transposed(columns_of + s + (m * K_BLOCKS + c) * 512, h[c]);
    };
    fetch(0, d[0], h[0]);
#pragma unroll
    for (int i = 0; i < 2 * SAMPLES; ++i) {
        const int now = i % 2;
        if (i + 1 < 2 * SAMPLES) fetch(i + 1, d[1 - now], h[1 - now]);
#pragma unroll
        for (int c = 0; c < COLUMNS; ++c) {
            if (PRE_ACTIVATIONS) {
#pragma unroll
                for (int r = 0; r < 4; ++r) h[now][c][r] = pack(hidden(low(h[now][c][r])), hidden(high(h[now][c][r])));
            }
#pragma unroll
            for (int row = 0; row < ROWS; ++row)
#pragma unroll
                for (int side = 0; side < 2; ++side) {
                    const int unit = (row * COLUMNS + c) * 2 + side;
                    real(&dw)[4] = *reinterpret_cast<real(*)[4]>(sum.c + SUMS + unit * 4);
                    multiply_add(dw, dw, d[now][row], h[now][c][2 * side], h[now][c][2 * side + 1]);
                }
        }
        if (!SHARED_BIAS || i / 2 % GROUPS == 0)
#pragma unroll
            for (int row = 0; row < ROWS; ++row) {
                real(&db)[4] = *reinterpret_cast<real(*)[4]>(sum.c + BIAS_SUMS + row * 4);
                multiply_add(db, db, d[now][row], one, one);
            }
    }
}
