// Functions of float, operation by operation those of Warp Neural on the CPU; within 4 units in the last place of float32.
// Reductions and their constants: Cody and Waite 1980, "Software Manual for the Elementary Functions".

template <class To, class From> inline To bits_as(From from) {
    To to;
    std::memcpy(&to, &from, sizeof(to));
    return to;
}
inline float multiply_add(float x, float y, float z) { return std::fma(x, y, z); }
inline float abs(float z) { return std::fabs(z); }
inline float sqrt(float z) { return std::sqrt(z); }
inline float floor(float z) { return std::floor(z); }
inline float min(float a, float b) { return b < a ? b : a; }
inline int min(int a, int b) { return b < a ? b : a; }
inline float max(float a, float b) { return a < b ? b : a; }
inline float pick(bool condition, float a, float b) { return condition ? a : b; }
inline float nearest(float z) { return std::nearbyint(z); }
// whole numbers from -2^22 to 2^22
inline float near_zero(float z) { return (z + 12582912.0f) - 12582912.0f; }
template <int N> inline float polynomial(float x, const float (&coefficients)[N]) {
    float y = coefficients[N - 1];
    for (int i = N - 2; i >= 0; --i) y = multiply_add(y, x, coefficients[i]);
    return y;
}
// Rounded to float16 and back, ties to even.
inline float to_half(float z) {
    const std::uint32_t bits = bits_as<std::uint32_t>(z), sign = bits & 0x80000000u, size = bits ^ sign;
    if (size < 0x38800000u) return bits_as<float>(bits_as<std::uint32_t>((bits_as<float>(size) + 0.5f) - 0.5f) | sign);
    if (size > 0x7f800000u) return z;
    if (size >= 0x477ff000u) return bits_as<float>(0x7f800000u | sign);
    return bits_as<float>(((size + 0xfffu + (size >> 13 & 1u)) & ~0x1fffu) | sign);
}
inline float exp(float z) {
    const float series[] = {0.5f, 0.16666577f, 0.041666853f, 0.00836314f, 0.0013901284f};
    z = z < -104.0f ? -104.0f : z > 89.0f ? 89.0f : z;  // 0 and infinity
    const float n = near_zero(z * 1.44269504f);
    const float r = multiply_add(n, 2.12194440e-4f, multiply_add(n, -0.693359375f, z));
    const int k = n == n ? static_cast<int>(n) : 0, lower = k >> 1;
    return multiply_add(polynomial(r, series), r * r, r + 1.0f) * bits_as<float>((lower + 127) << 23) *
           bits_as<float>((k - lower + 127) << 23);
}
inline float log(float z) {
    const float series[] = {0.33333331f,  -0.24999994f, 0.20000715f,  -0.16668058f, 0.14249323f,
                            -0.12420144f, 0.11677003f,  -0.11514591f, 0.070376481f};
    const bool tiny = z < 1.17549435e-38f;
    const int bits = bits_as<int>(tiny ? z * 8388608.0f : z), e = (bits - 0x3f3504f3) >> 23;  // m from sqrt(0.5) to sqrt(2)
    const float t = bits_as<float>(bits - static_cast<int>(static_cast<unsigned>(e) << 23)) - 1.0f;
    const float n = static_cast<float>(e) - (tiny ? 23.0f : 0.0f);
    float y = multiply_add(polynomial(t, series), t * t * t, n * -2.12194440e-4f);
    y = multiply_add(n, 0.693359375f, multiply_add(t * t, -0.5f, y) + t);
    y = z == 0.0f ? -std::numeric_limits<float>::infinity() : z < 0.0f ? std::numeric_limits<float>::quiet_NaN() : y;
    return z < std::numeric_limits<float>::infinity() ? y : z;
}
inline float tanh_of(float z) {
    const float series[] = {-0.33333329f, 0.13332768f, -0.0538508f, 0.020996831f, -0.0060963448f};
    const float a = abs(z), s = z * z, e = exp(2.0f * a), far = 1.0f - 2.0f / (e + 1.0f);
    return a < 0.625f ? multiply_add(polynomial(s, series), s * z, z) : std::copysign(far, z);
}
inline float erf(float z) {
    const float series[] = {1.1283792f,    -0.37612626f,    0.11283585f, -0.026853812f,
                            0.0051883276f, -0.00080101932f, 7.85386e-05f};
    const float tail[] = {-0.00015318748f, 0.28489624f, 0.25980172f, 0.34736092f,
                          -0.10259424f,    0.56187305f, -0.4701517f, 0.11901603f};
    const float a = abs(z), s = z * z, t = 2.0f / (2.0f + a), far = 1.0f - exp(-s) * polynomial(t, tail);
    return a < 1.0f ? z * polynomial(s, series) : std::copysign(a > 4.0f ? 1.0f : far, z);
}
inline float sine(float z, int quarters) {
    const float odd_series[] = {-0.16666665f, 0.0083327418f, -0.00019586953f};
    const float even_series[] = {0.041666664f, -0.0013888269f, 2.454352e-05f};
    const float n = near_zero(z * 0.636619772f);
    const float r = multiply_add(n, -7.54978942e-8f, multiply_add(n, -4.83751297e-4f, multiply_add(n, -1.5703125f, z)));
    const float s = r * r, odd = multiply_add(polynomial(s, odd_series), s * r, r),
                even = multiply_add(polynomial(s, even_series), s * s, multiply_add(s, -0.5f, 1.0f));
    const int k = static_cast<int>(n) + quarters;
    return bits_as<float>(bits_as<std::uint32_t>((k & 1) != 0 ? even : odd) ^ static_cast<std::uint32_t>(k & 2) << 30);
}
inline float sin(float z) { return abs(z) <= 8192.0f ? sine(z, 0) : std::sin(z); }
inline float cos(float z) { return abs(z) <= 8192.0f ? sine(z, 1) : std::cos(z); }
inline float quartic(float u) {
    u = min(max(u, -1.0f), 1.0f);
    return 0.5f + u * (0.9375f + u * u * (-0.625f + 0.1875f * u * u));
}
