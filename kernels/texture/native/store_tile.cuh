// A tile's results to memory. Names as in `decode_tile.cuh`; rectangle; Value, Pair: C++ types of one and of two channels
// in `values`; pair_of; c[m][i][2 h + k]: of texel (m, h) channel 8 i + 2 t + k.

UNROLL for (int m = 0; m < 2; ++m) UNROLL for (int h = 0; h < 2; ++h) {
    const int row = static_cast<int>(y) + m - rectangle.c[1], column = static_cast<int>(x) + h - rectangle.c[0];
    if (row < 0 || row >= rectangle.c[3] || column < 0 || column >= rectangle.c[2]) continue;
    Value* texel = values.data + (static_cast<size_t>(row) * rectangle.c[2] + column) * CHANNELS;
    UNROLL for (int i = 0; i < (CHANNELS + 7) / 8; ++i) {
        const int channel = 8 * i + 2 * t;
        const Pair two = pair_of(c[m][i][2 * h], c[m][i][2 * h + 1]);
        if (CHANNELS % 2 == 0) {
            if (channel < CHANNELS) *reinterpret_cast<Pair*>(texel + channel) = two;
        } else {
            const Value* one = reinterpret_cast<const Value*>(&two);
            if (channel < CHANNELS) texel[channel] = one[0];
            if (channel + 1 < CHANNELS) texel[channel + 1] = one[1];
        }
    }
}
