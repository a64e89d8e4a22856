// Every latent of a block with the table of its context: rows from row to row_end, columns from column to column_end,
// channels inside. CODE stands for the text that reads or writes the latent: from `table`, `centre` and `phase` it sets
// `latent` and stores it in here[c]. docs/wntc.md states the same in words. Integers only: every machine has the same.
// Names: latents [rows, columns, channels], parents [parent_rows, parent_columns, parent_channels], a context's
// numbers one after the other in `context`, `tables` and their `offsets`, ratio of a parent's cell to a latent's, side of
// whole blocks in cells, space for 56 side + 72 ints.

const int n = channels, lanes = (n + 7) & ~7;  // eight side by side: one vector of CPUs; the context has zeros between
const int* __restrict__ const scale_0 = context;
const int* __restrict__ const mean_0 = scale_0 + lanes;
const int* __restrict__ const scale_near = mean_0 + lanes;
const int* __restrict__ const mean_near = scale_near + 6 * lanes;
const int* __restrict__ const scale_of = mean_near + 6 * lanes;
const int* __restrict__ const mean_of = scale_of + n * lanes;
const int* __restrict__ const scale_parent = mean_of + n * lanes;
int scale[32], mean[32];
int* __restrict__ const of_parents = space;  // of each parent of the row, [., 32]
// This row and two before, from two columns to the left to one to the right, [3, side + 3, 32].
signed char* __restrict__ const recent = (signed char*)(space + 32 * side);
const int pitch = 32 * (side + 3);
for (int i = 0; i < 3 * pitch; ++i) recent[i] = 0;
for (int y = row; y < row_end; ++y) {
    if ((y & (ratio - 1)) == 0) {
        const int up = y / ratio, down = up + 1 < parent_rows ? up + 1 : 0;
        for (int left = column / ratio; left * ratio < column_end; ++left) {
            const int right = left + 1 < parent_columns ? left + 1 : 0;
            const signed char* const a = parents + ((long long)up * parent_columns + left) * parent_channels;
            const signed char* const b = parents + ((long long)up * parent_columns + right) * parent_channels;
            const signed char* const d = parents + ((long long)down * parent_columns + left) * parent_channels;
            const signed char* const e = parents + ((long long)down * parent_columns + right) * parent_channels;
            int* __restrict__ const sum = of_parents + 32 * (left - column / ratio);
            for (int c = 0; c < lanes; ++c) sum[c] = scale_0[c];
            for (int p = 0; p < parent_channels; ++p) {
                const int sizes = (a[p] < 0 ? -a[p] : a[p]) + (b[p] < 0 ? -b[p] : b[p]) + (d[p] < 0 ? -d[p] : d[p]) +
                                  (e[p] < 0 ? -e[p] : e[p]);
                for (int v = 0; v < lanes; v += 8)
                    for (int c = v; c < v + 8; ++c) sum[c] += scale_parent[p * lanes + c] * sizes;
            }
        }
    }
    signed char* const row_0 = recent + y % 3 * pitch + 64;
    const signed char* const row_1 = recent + (y + 2) % 3 * pitch + 64;
    const signed char* const row_2 = recent + (y + 1) % 3 * pitch + 64;
    const int* above = of_parents;
    for (int x = column; x < column_end; ++x) {
        const int i = 32 * (x - column);
        const signed char* const near[6] = {row_0 + i - 32, row_1 + i,      row_1 + i - 32,
                                            row_1 + i + 32, row_0 + i - 64, row_2 + i};
        for (int v = 0; v < lanes; v += 8) {
            int s[8], m[8];
            for (int c = 0; c < 8; ++c) s[c] = above[v + c];
            for (int c = 0; c < 8; ++c) m[c] = mean_0[v + c];
            for (int k = 0; k < 6; ++k)
                for (int c = 0; c < 8; ++c) {
                    const int q = near[k][v + c];
                    s[c] += scale_near[k * lanes + v + c] * (q < 0 ? -q : q);
                    m[c] += mean_near[k * lanes + v + c] * q;
                }
            for (int c = 0; c < 8; ++c) scale[v + c] = s[c];
            for (int c = 0; c < 8; ++c) mean[v + c] = m[c];
        }
        above += ((x + 1) & (ratio - 1)) == 0 ? 32 : 0;
        signed char* const here = latents + ((long long)y * columns + x) * n;
        for (int c = 0; c < n; ++c) {
            const int s = scale[c] < 1 << 6 ? 1 << 6 : scale[c] >= 1 << 18 ? (1 << 18) - 1 : scale[c];
#if defined(__CUDA_ARCH__)
            const int octave = 31 - __clz(s);
#else
            const int octave = 31 - __builtin_clz(s);
#endif
            const int bin = (octave - 6) * 8 + ((s >> (octave - 3)) & 7);
            const int most = 127 << 12, m = mean[c] < -most ? -most : mean[c] > most ? most : mean[c];
            const int eighths = (m + 256) >> 9, centre = (eighths + 4) >> 3, phase = eighths - 8 * centre;
            const int which = bin * 5 + (phase < 0 ? -phase : phase);
            const unsigned short* const table = tables + offsets[which];
            int latent;
            CODE
            row_0[i + c] = (signed char)latent;
            if (latent) {
                const int size = latent < 0 ? -latent : latent;
                for (int v = c & ~7; v < lanes; v += 8)
                    for (int d = v; d < v + 8; ++d) {
                        scale[d] += scale_of[c * lanes + d] * size;
                        mean[d] += mean_of[c * lanes + d] * latent;
                    }
            }
        }
    }
}
