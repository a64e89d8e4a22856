// Pairs of 16 bits in fragments: 8 x 8 blocks transposed, and functions of both values.
// Names: pack, low, high of the format.

auto map = [&](auto f, unsigned v) { return pack(f(low(v)), f(high(v))); };
auto transposed = [](unsigned v) {
    unsigned r;
    asm volatile("movmatrix.sync.aligned.m8n8.trans.b16 %0,%1;" : "=r"(r) : "r"(v));
    return r;
};
