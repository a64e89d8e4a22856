// Operands of unsigned bytes, products of 32 inputs: bytes of lane t are the columns 2 t and 2 t + 1 of four slabs or tiles.
// Names: decode_tile.cuh; terms: steps and biases of two outputs, biases less what the sum starts from; RANGES: where they
// begin, in 8 bytes; HIDDEN: those of layers after the ones of features.

typedef integer Sum[4];
typedef Sum LastSum;
auto begin = [](float4 terms, Sum& c) { UNROLL for (int i = 0; i < 4; ++i) c[i] = 0x4b400000; };  // 1.5 * 2^23
auto begin_last = begin;
auto finish_last = [](const Sum& c, float4 terms, real (&z)[4]) {
    UNROLL for (int i = 0; i < 4; ++i)
        z[i] = fmaf(__int_as_float(c[i]), i % 2 ? terms.y : terms.x, i % 2 ? terms.w : terms.z);
};
auto finish = [&](const Sum& c, float4 terms, unsigned (&z)[2]) {
    real v[4];
    finish_last(c, terms, v);
    z[0] = half_pack(v[0], v[1]);
    z[1] = half_pack(v[2], v[3]);
};
auto half_fma_sat = [](unsigned a, unsigned b, unsigned c) {
    unsigned r;
    asm("fma.rn.sat.f16x2 %0,%1,%2,%3;" : "=r"(r) : "r"(a), "r"(b), "r"(c));
    return r;
};
// Two values, as parts of their range 0 to 255, in the low bytes of halves: 1024 + 255 (v range.x + range.y).
auto rounded = [&](unsigned v, uint2 range) {
    return half_fma(half_fma_sat(v, range.x, range.y), 0x5bf85bf8u, 0x64006400u);
};
auto range_at = [&](int at) { return __ldg(reinterpret_cast<const uint2*>(tables.data) + RANGES + at); };
// Features of four slabs, the first of which is number `slab` of all.
auto put_features = [&](unsigned (&f)[4][4], int slab, unsigned (&a)[2][4]) {
    UNROLL for (int s = 0; s < 4; ++s) {
        const uint2 range = range_at(4 * (slab + s) + t);
        UNROLL for (int i = 0; i < 4; ++i) f[s][i] = rounded(f[s][i], range);
    }
    UNROLL for (int i = 0; i < 8; ++i)
        a[i / 2 % 2][i / 4 * 2 + i % 2] = __byte_perm(f[i / 4 * 2][i % 4], f[i / 4 * 2 + 1][i % 4], 0x6420);
};
// Activations of 16 outputs, half of an operand; layer: where its biases begin.
auto put_outputs = [&](const unsigned (&z)[2][2], int layer, int j, unsigned (*a)[4]) {
    const uint2 range[2] = {range_at(HIDDEN + layer + 8 * j + t), range_at(HIDDEN + layer + 8 * j + 4 + t)};
    UNROLL for (int h = 0; h < 2; ++h) {
        unsigned v[2];
        UNROLL for (int i = 0; i < 2; ++i) v[i] = rounded(activate(z[i][h]), range[i]);
        a[j / 2][j % 2 * 2 + h] = __byte_perm(v[0], v[1], 0x6420);
    }
};
