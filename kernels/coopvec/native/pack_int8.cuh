// Four integers from -128 to 127: adding 1.5 * 2^23 rounds, and leaves the integer in the low bits. A fraction is one
// of 127. Names: real.

auto byte_of = [](real x) { return __float_as_uint(x + 12582912.0f); };
auto bytes_of = [](unsigned a, unsigned b, unsigned c, unsigned d) {
    return __byte_perm(__byte_perm(a, b, 0x0040), __byte_perm(c, d, 0x0040), 0x5410);
};
auto clamped = [&](real x) { return byte_of(fminf(fmaxf(x, -128.0f), 127.0f)); };
auto pack = [&](real a, real b, real c, real d) { return bytes_of(clamped(a), clamped(b), clamped(c), clamped(d)); };
auto fraction = [&](real x) { return __float_as_uint(fmaf(x, 127.0f, 12582912.0f)); };
auto pack_fractions = [&](real a, real b, real c, real d) {
    return bytes_of(fraction(a), fraction(b), fraction(c), fraction(d));
};
