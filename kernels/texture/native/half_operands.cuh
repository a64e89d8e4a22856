// Operands of float16, products of 16 inputs. Hidden layers sum in float16, which halves the registers; the last in float32.
// Names: decode_tile.cuh; terms: the biases of two outputs, twice.

typedef unsigned Sum[2];  // of rows g and g + 8, outputs 2 t and 2 t + 1
typedef real LastSum[4];
auto begin = [&](float4 terms, Sum& c) { c[0] = c[1] = half_pack(terms.x, terms.y); };
auto begin_last = [](float4 terms, LastSum& c) {
    c[0] = terms.x;
    c[1] = terms.y;
    c[2] = terms.z;
    c[3] = terms.w;
};
auto finish = [](const Sum& c, float4 terms, unsigned (&z)[2]) {
    z[0] = c[0];
    z[1] = c[1];
};
auto finish_last = [](const LastSum& c, float4 terms, real (&z)[4]) { UNROLL for (int i = 0; i < 4; ++i) z[i] = c[i]; };
// Features of two slabs as the operand of a product.
auto put_features = [](const unsigned (&f)[2][4], int slab, unsigned (&a)[2][4]) {
    UNROLL for (int i = 0; i < 8; ++i) a[i / 2 % 2][i / 4 * 2 + i % 2] = f[i / 4][i % 4];
};
// Pre-activations of 16 outputs, number j of a layer's, as the operand of 16 inputs.
auto put_outputs = [&](const unsigned (&z)[2][2], int layer, int j, unsigned (*a)[4]) {
    UNROLL for (int i = 0; i < 4; ++i) a[j][i] = activate(z[i / 2][i % 2]);
};
