// Every latent of a block with the table of its context: rows from row to row_end, columns from column to column_end,
// channels inside. CODE stands for the text that reads or writes the latent: from `table`, number w, `centre` and
// `phase` it sets `latent`; ZERO for what comes before. docs/wntc.md states the same in words. Integers, and floats that
// hold them exactly: every machine has the same. Constants: TABLES, how many; AFTER, entries after each.
// Names: lanes.h; latents [rows, columns, channels], parents [parent_rows, parent_columns, parent_channels], a
// context's numbers one after the other in `context`, `tables` and their `offsets`, `zeros`: of each table the last
// value of 0, then of each -1, for where 0 is not the nearest symbol; ratio of a parent's cell to a latent's, side of
// whole blocks in cells, space for 56 side + 72 ints.

const int* __restrict__ const scale_0 = context;
const int* __restrict__ const mean_0 = scale_0 + width;
const int* __restrict__ const scale_near = mean_0 + width;
const int* __restrict__ const mean_near = scale_near + 6 * width;
const int* __restrict__ const scale_of = mean_near + 6 * width;
const int* __restrict__ const mean_of = scale_of + n * width;
const int* __restrict__ const scale_parent = mean_of + n * width;
int* __restrict__ const of_parents = space;  // of each parent of the row, [., 32]
// This row and two before, from two columns to the left to one to the right, [3, side + 3, 32].
signed char* __restrict__ const recent = (signed char*)(space + 32 * side);
const int pitch = 32 * (side + 3);
for (int i = 0; i < 3 * pitch; i += 32)
    for (int first = 0; first < width; first += 8) store_bytes(recent + i, first, 0);
Eight scale[VECTORS], mean[VECTORS], eighths[VECTORS], which[VECTORS], of_zero[VECTORS];
const auto choose = [&](int v) {  // tables; TABLES more where 0 is not the nearest
    // Of a float the exponent and the three bits after the highest.
    const Eight bin = (float_bits(between(1 << 6, scale[v], (1 << 18) - 1)) >> 20) - (127 + 6) * 8;
    const Eight e = (between(-(127 << 12), mean[v], 127 << 12) + 256) >> 9, centre = (e + 4) >> 3;
    eighths[v] = e;
    which[v] = bin * 5 + magnitude(e - 8 * centre) + between(0, magnitude(centre), 1) * TABLES;
    look_up(zeros, which, of_zero, v);
};
for (int y = row; y < row_end; ++y) {
    if ((y & (ratio - 1)) == 0) {
        const int up = y / ratio, down = up + 1 < parent_rows ? up + 1 : 0;
        for (int left = column / ratio; left * ratio < column_end; ++left) {
            const int right = left + 1 < parent_columns ? left + 1 : 0;
            const signed char* const a = parents + ((long long)up * parent_columns + left) * parent_channels;
            const signed char* const b = parents + ((long long)up * parent_columns + right) * parent_channels;
            const signed char* const d = parents + ((long long)down * parent_columns + left) * parent_channels;
            const signed char* const e = parents + ((long long)down * parent_columns + right) * parent_channels;
            for (int v = 0; v < vectors; ++v) scale[v] = load(scale_0, v);
            for (int p = 0; p < parent_channels; ++p) {
                const int sizes = (a[p] < 0 ? -a[p] : a[p]) + (b[p] < 0 ? -b[p] : b[p]) + (d[p] < 0 ? -d[p] : d[p]) +
                                  (e[p] < 0 ? -e[p] : e[p]);
                for (int v = 0; v < vectors; ++v) scale[v] += load(scale_parent + p * width, v) * sizes;
            }
            for (int v = 0; v < vectors; ++v) store(of_parents + 32 * (left - column / ratio), v, scale[v]);
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
        for (int v = 0; v < vectors; ++v) {
            Eight s = load(above, v), m = load(mean_0, v);
            for (int k = 0; k < 6; ++k) {
                const Eight q = load_bytes(near[k], v);
                s += load(scale_near + k * width, v) * magnitude(q);
                m += load(mean_near + k * width, v) * q;
            }
            scale[v] = s;
            mean[v] = m;
            choose(v);
        }
        above += ((x + 1) & (ratio - 1)) == 0 ? 32 : 0;
        signed char* const here = latents + ((long long)y * columns + x) * n;
        for (int first = 0; first < n; first += 8) {
            unsigned long long eight = 0;  // latents, a byte each
            for (int c = first; c < n && c < first + 8; ++c) {
                ZERO
                const int e = of(eighths, c), centre = (e + 4) >> 3, phase = e - 8 * centre;
                const int w = of(which, c) - (centre ? TABLES : 0);
                const unsigned short* const table = tables + offsets[w];
                int latent;
                CODE
                if (!latent) continue;
                eight |= (unsigned long long)(unsigned char)latent << 8 * (c - first);
                const int size = latent < 0 ? -latent : latent;
                for (int v = 0; v < vectors; ++v) {
                    scale[v] += load(scale_of + c * width, v) * size;
                    mean[v] += load(mean_of + c * width, v) * latent;
                    choose(v);
                }
            }
            store_bytes(row_0 + i, first, eight);
        }
    }
}
