// Operands of float16, products of 16 inputs. Names: decode_tile.cuh; terms: the biases of two outputs, twice.

auto begin = [](float4 terms, real (&c)[4]) {
    c[0] = terms.x;
    c[1] = terms.y;
    c[2] = terms.z;
    c[3] = terms.w;
};
auto finish = [](const real (&c)[4], float4 terms, real (&z)[4]) { UNROLL for (int i = 0; i < 4; ++i) z[i] = c[i]; };
// Features of two slabs as the operand of a product.
auto put_features = [](const unsigned (&f)[2][4], int slab, unsigned (&a)[2][4]) {
    UNROLL for (int i = 0; i < 8; ++i) a[i / 2 % 2][i / 4 * 2 + i % 2] = f[i / 4][i % 4];
};
// Pre-activations of 16 outputs, number j of a layer's, as the operand of 16 inputs.
auto put_outputs = [&](const real (&z)[2][4], int layer, int j, unsigned (*a)[4]) {
    UNROLL for (int i = 0; i < 4; ++i) a[j][i] = activate(half_pack(z[i / 2][i % 2 * 2], z[i / 2][i % 2 * 2 + 1]));
};
