// 16 vectors to one: element i is the sum of p[i]. Interleaving halves at each step leaves the sums in order.
// Names: vectors.h.

const auto halves = [](v16 a, v16 b) {
    return __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23) +
           __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
};
const auto transposed_sum = [&](v16* p) {
    for (int i = 0; i < 8; ++i) p[i] = halves(p[i], p[i + 8]);
    for (int i = 0; i < 4; ++i) p[i] = halves(p[i], p[i + 4]);
    return halves(halves(p[0], p[2]), halves(p[1], p[3]));
};
