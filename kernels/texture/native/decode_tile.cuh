// What `tensor_cores.py` calls for a warp's tile, 8 x 4 texels in 2 x 2 blocks: block g of lanes 4 g to 4 g + 3, texel
// (m, h) of it, row and column, in row g + 8 h of matrix m. Names: real, params, tables, weights, biases, mip, top, left
// (of the tile), lane, g = lane / 4, t = lane % 4.
// Fragments of `mma.m16n8k16`: PTX ISA, "Matrix Fragments for mma.m16n8k16 with floating point type".

const unsigned y = top + g / 4 * 2, x = left + g % 4 * 2;  // of the block

auto half_fma = [](unsigned a, unsigned b, unsigned c) {
    unsigned r;
    asm("fma.rn.f16x2 %0,%1,%2,%3;" : "=r"(r) : "r"(a), "r"(b), "r"(c));
    return r;
};
// Places of the first latents of the cells that the block reads.
auto locate = [&](auto grid, unsigned (&cells)[4]) {
    using G = decltype(grid);
    const int rows = params.levels.rows.data[mip * GRIDS + G::INDEX];
    const int columns = params.levels.columns.data[mip * GRIDS + G::INDEX];
    const int row = min(static_cast<int>(y / G::SCALE), rows - 1), column = min(static_cast<int>(x / G::SCALE), columns - 1);
    const int below = row + 1 < rows ? row + 1 : 0, right = column + 1 < columns ? column + 1 : 0;
    cells[0] = (row * columns + column) * G::CHANNELS;
    cells[1] = (row * columns + right) * G::CHANNELS;
    cells[2] = (below * columns + column) * G::CHANNELS;
    cells[3] = (below * columns + right) * G::CHANNELS;
};
// Latents c and c + next of a cell as two halves; next is 1 or, where only the first counts, 0. Codes become the low bits
// of 1024, but two of 4 bits bits 0 to 3 and 4 to 7 of it, as of one byte; one bit the sign of 1.
auto latents_of = [&](auto grid, unsigned start, unsigned cell, unsigned c, unsigned next) {
    using G = decltype(grid);
    constexpr unsigned each = 32 / G::BITS, mask = (1u << G::BITS) - 1u;  // codes of a word
    constexpr bool whole = G::CHANNELS % each == 0;
    auto word_of = [&](unsigned i) {
        const unsigned at = whole ? cell / each + i / each : (cell + i) / each;
        return __ldg(params.latents.data + (start + at));
    };
    auto shift_of = [&](unsigned i) { return (whole ? i : cell + i) % each * G::BITS; };
    unsigned v = word_of(c) >> shift_of(c);
    if constexpr (G::CHANNELS % 2 == 1) v = v & mask | word_of(c + next) >> shift_of(c + next) << G::BITS;
    if constexpr (G::BITS == 1) return (v & 3u) * 0x40008000u & 0x80008000u ^ 0xbc00bc00u;
    if constexpr (G::BITS == 2) v = v & 3u | v << 14 & 0x30000u | 0x64006400u;
    if constexpr (G::BITS == 4) v = __byte_perm(v, 0x64u, 0x4040u) & 0xfff0ff0fu;
    if constexpr (G::BITS == 8) v = __byte_perm(v, 0x64u, 0x4140u);
    constexpr unsigned low = 0xe400u + G::LIMIT;  // -1024 - LIMIT
    if constexpr (G::BITS == 4) return half_fma(v, 0x2c003c00u, (0xd400u + 16u * G::LIMIT) << 16 | low);
    return half_fma(v, 0x3c003c00u, low << 16 | low);
};
// Channels 8 s + 2 t and the next of all four texels.
auto features_of = [&](auto grid, int s, const unsigned (&cells)[4], unsigned (&f)[4]) {
    using G = decltype(grid);
    const unsigned channel = 8 * s + 2 * t, c = channel < G::CHANNELS ? channel : 0;  // padding has weights 0
    const unsigned start = params.starts.data[mip * GRIDS + G::INDEX];
    unsigned q[4];
    UNROLL for (int k = 0; k < 4; ++k) q[k] = latents_of(grid, start, cells[k], c, c + 1 < G::CHANNELS);
    constexpr unsigned side = G::SCALE / 2, phases = side * side;
    const unsigned phase = y / 2 % side * side + x / 2 % side;
    const uint4* table = reinterpret_cast<const uint4*>(tables.data) + (G::TABLE + phase * 4 + t);
    UNROLL for (int i = 0; i < 4; ++i) {
        const uint4 w = __ldg(table + (4 * s + i) * phases * 4);
        const unsigned upper = half_fma(w.y, q[1], half_fma(w.x, q[0], 0x80008000u));
        f[i] = half_fma(w.w, q[3], half_fma(w.z, q[2], upper));
    }
};
auto biases_at = [&](int at, int j) {  // of outputs 8 j + 2 t and the next
    return __ldg(reinterpret_cast<const float2*>(biases.data) + mip * LEVEL_BIASES + at + 4 * j + t);
};
auto weights_at = [&](int at) { return __ldg(reinterpret_cast<const uint4*>(weights.data) + at * 32 + lane); };
auto activate = [&](unsigned z) {  // ELU times log2 e, of z log2 e: max(z, (e^z - 1) log2 e)
    unsigned e = half_min(z, 0u);
    asm("ex2.approx.f16x2 %0,%0;" : "+r"(e));
    return half_max(z, half_fma(e, 0x3dc53dc5u, 0xbdc5bdc5u));
};
auto code = [](real v) { return static_cast<unsigned>(__saturatef(v) * 255.0f + 0.5f); };

// Sums of rows g and g + 8, outputs 2 t and 2 t + 1. Hidden layers sum in float16, which halves the registers; the last in
// float32.
typedef unsigned Sum[2];
typedef real LastSum[4];
auto begin = [&](float2 bias, Sum& c) { c[0] = c[1] = half_pack(bias.x, bias.y); };
auto begin_last = [](float2 bias, LastSum& c) { UNROLL for (int i = 0; i < 4; ++i) c[i] = i % 2 ? bias.y : bias.x; };
// Features of two slabs as the operand of a product.
auto put_features = [](const unsigned (&f)[2][4], unsigned (&a)[2][4]) {
    UNROLL for (int i = 0; i < 8; ++i) a[i / 2 % 2][i / 4 * 2 + i % 2] = f[i / 4][i % 4];
};
// Activations of 16 outputs, number j of a layer's, as the operand of 16 inputs.
auto put_outputs = [&](const Sum (&c)[2], unsigned (&a)[4]) {
    UNROLL for (int i = 0; i < 4; ++i) a[i] = activate(c[i / 2][i % 2]);
};
