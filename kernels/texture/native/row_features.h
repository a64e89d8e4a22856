// Features of `count` texels of row i from column j0 on, to rows of h0. Names: vectors.h; params, tables, mip, GRIDS, K (of
// a row of h0).

auto add_grid = [&](auto grid) {
    using G = decltype(grid);
    constexpr int width = (G::CHANNELS + 15) / 16 * 16, each = 32 / G::BITS;
    const int rows = params.levels.rows.data[mip * GRIDS + G::INDEX];
    const int columns = params.levels.columns.data[mip * GRIDS + G::INDEX];
    const int row = i / G::SCALE, below = row + 1 < rows ? row + 1 : 0;
    const wp::uint32* const words = params.latents.data + params.starts.data[mip * GRIDS + G::INDEX];
    const real* const table = tables.data + G::TABLE + i % G::SCALE * G::SCALE * 4 * width;
    alignas(64) real latents[2][2][width] = {};  // of columns in turn, of both rows
    auto read = [&](int column, real (&values)[2][width]) {
        for (int r = 0; r < 2; ++r) {
            const unsigned first = ((r == 0 ? row : below) * columns + column) * G::CHANNELS;
            for (unsigned c = 0; c < G::CHANNELS; ++c) {
                const unsigned at = first + c, code = words[at / each] >> (at % each * G::BITS) & ((1u << G::BITS) - 1u);
                values[r][c] = G::BITS == 1 ? 2.0f * code - 1.0f : static_cast<real>(static_cast<wp::int32>(code)) - G::LIMIT;
            }
        }
    };
    int column = j0 / G::SCALE;
    read(column, latents[column % 2]);
    for (int j = j0; j < j0 + count; ++column) {
        real (&own)[2][width] = latents[column % 2], (&right)[2][width] = latents[1 - column % 2];
        read(column + 1 < columns ? column + 1 : 0, right);
        for (const int end = wp::min((column + 1) * G::SCALE, j0 + count); j < end; ++j) {
            const real* const w = table + j % G::SCALE * 4 * width;
            real* const x = h0 + (j - j0) * K + G::FIRST;
#pragma unroll
            for (int c = 0; c < G::CHANNELS; c += 16) {
                v16 y = load(w + c) * load(own[0] + c);
                y = fma(load(w + width + c), load(right[0] + c), y);
                y = fma(load(w + 2 * width + c), load(own[1] + c), y);
                y = fma(load(w + 3 * width + c), load(right[1] + c), y);
                __builtin_memcpy(x + c, &y, (G::CHANNELS - c < 16 ? G::CHANNELS - c : 16) * sizeof(real));
            }
        }
    }
};
