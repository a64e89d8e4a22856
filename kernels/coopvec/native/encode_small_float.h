// `encode_small_float(x)`: sign, exponent, mantissa in 8 bits (Micikevicius et al. 2022, "FP8 formats for deep
// learning"), saturating. With step the spacing of the format at |x|, the code is the integer |x| / step plus the
// exponent's own steps; a carry out of the mantissa lands in the exponent by itself.
// Constants: MANTISSA, MIN_EXPONENT, LARGEST.

auto encode_small_float = [](wp::float32 x) -> unsigned {
    unsigned b;
    memcpy(&b, &x, 4);
    const unsigned sign = b >> 24 & 0x80u;
    if (x != x) return sign | 0x7fu;
    const wp::float32 a = wp::min(wp::abs(x), LARGEST);
    memcpy(&b, &a, 4);
    const int exponent = wp::max(static_cast<int>(b >> 23) - 127, MIN_EXPONENT);
    const unsigned step_bits = static_cast<unsigned>(exponent - MANTISSA + 127) << 23;
    wp::float32 step;
    memcpy(&step, &step_bits, 4);
    const int first = (exponent - MIN_EXPONENT) << MANTISSA;
    return sign | static_cast<unsigned>(first + static_cast<int>(wp::rint(a / step)));
};
