// `rounded(z)` to 8 bits. The addition of 1.5 * 2^23 steps leaves whole steps, rounded to even; the step follows from
// the exponent of z. Constants: MANTISSA, MIN_EXPONENT, LARGEST. Names: vectors.h.

const auto rounded = [&](v16 z) {
    const u16 magnitude = bits(z) & 0x7fffffffu;
    const v16 a = value(magnitude) > LARGEST ? v16(LARGEST) : value(magnitude);
    const u16 exponent = __builtin_elementwise_max(bits(a) & 0x7f800000u, u16(unsigned(127 + MIN_EXPONENT) << 23));
    const v16 shift = value((exponent + (unsigned(23 - MANTISSA) << 23)) | 0x400000u);
    return value(bits((a + shift) - shift) | (bits(z) & 0x80000000u));
};
