// Functions of 16 floats. Names: vectors.h.
// Within 4 units in the last place of float32 (erf; all others 2) where the result is not near a zero far from z = 0,
// and as the library's for what is not finite. Reductions and their constants: Cody and Waite 1980, "Software Manual
// for the Elementary Functions"; the polynomials were fitted to the smallest relative error (iteratively reweighted
// least squares).

typedef int i16 __attribute__((ext_vector_type(16)));
struct Math {
    static v16 value(i16 b) { return __builtin_bit_cast(v16, b); }
    static v16 fma(v16 x, v16 y, v16 z) { return __builtin_elementwise_fma(x, y, z); }
    static v16 abs(v16 z) { return __builtin_elementwise_abs(z); }
    static v16 sqrt(v16 z) { return __builtin_elementwise_sqrt(z); }
    // whole numbers from -2^22 to 2^22
    static v16 nearest(v16 z) { return (z + 12582912.0f) - 12582912.0f; }
    // from the constant up, by Horner's rule
    static v16 polynomial(v16 x, const real* coefficients, int n) {
        v16 y = v16(coefficients[n - 1]);
#pragma unroll
        for (int i = n - 2; i >= 0; --i) y = fma(y, x, v16(coefficients[i]));
        return y;
    }
    static v16 exp(v16 z) {
        constexpr real series[] = {0.5f, 0.16666577f, 0.041666853f, 0.00836314f, 0.0013901284f};
        z = z < -104.0f ? v16(-104.0f) : z > 89.0f ? v16(89.0f) : z;  // 0 and infinity
        const v16 n = nearest(z * 1.44269504f);
        const v16 r = fma(n, v16(2.12194440e-4f), fma(n, v16(-0.693359375f), z));
        const i16 k = __builtin_convertvector(n, i16), half = k >> 1;
        return fma(polynomial(r, series, 5), r * r, r + 1.0f) * value((half + 127) << 23) *
               value((k - half + 127) << 23);
    }
    static v16 log(v16 z) {
        constexpr real series[] = {0.33333331f,  -0.24999994f, 0.20000715f,  -0.16668058f, 0.14249323f,
                                   -0.12420144f, 0.11677003f,  -0.11514591f, 0.070376481f};
        const v16 x = z < 1.17549435e-38f ? z * 8388608.0f : z;
        const i16 bits = __builtin_bit_cast(i16, x), e = (bits - 0x3f3504f3) >> 23;  // m from sqrt(0.5) to sqrt(2)
        const v16 t = value(bits - (e << 23)) - 1.0f;
        const v16 n = __builtin_convertvector(e, v16) - (z < 1.17549435e-38f ? v16(23.0f) : v16(0.0f));
        v16 y = fma(polynomial(t, series, 9), t * t * t, n * -2.12194440e-4f);
        y = fma(n, v16(0.693359375f), fma(t * t, v16(-0.5f), y) + t);
        y = z == 0.0f ? v16(-__builtin_inff()) : z < 0.0f ? v16(__builtin_nanf("")) : y;
        return z < __builtin_inff() ? y : z;
    }
    static v16 tanh(v16 z) {
        constexpr real series[] = {-0.33333329f, 0.13332768f, -0.0538508f, 0.020996831f, -0.0060963448f};
        const v16 a = abs(z), s = z * z, e = exp(2.0f * a), far = 1.0f - 2.0f / (e + 1.0f);
        return a < 0.625f ? fma(polynomial(s, series, 5), s * z, z) : __builtin_elementwise_copysign(far, z);
    }
    static v16 erf(v16 z) {
        constexpr real series[] = {1.1283792f,    -0.37612626f,    0.11283585f, -0.026853812f,
                                   0.0051883276f, -0.00080101932f, 7.85386e-05f};
        constexpr real tail[] = {-0.00015318748f, 0.28489624f, 0.25980172f, 0.34736092f,
                                 -0.10259424f,    0.56187305f, -0.4701517f, 0.11901603f};
        const v16 a = abs(z), s = z * z, t = 2.0f / (2.0f + a), far = 1.0f - exp(-s) * polynomial(t, tail, 8);
        return a < 1.0f ? z * polynomial(s, series, 7) : __builtin_elementwise_copysign(a > 4.0f ? v16(1.0f) : far, z);
    }
    static v16 sine(v16 z, int quarters) {
        constexpr real odd_series[] = {-0.16666665f, 0.0083327418f, -0.00019586953f};
        constexpr real even_series[] = {0.041666664f, -0.0013888269f, 2.454352e-05f};
        const v16 n = nearest(z * 0.636619772f);
        const v16 r = fma(n, v16(-7.54978942e-8f), fma(n, v16(-4.83751297e-4f), fma(n, v16(-1.5703125f), z)));
        const v16 s = r * r, odd = fma(polynomial(s, odd_series, 3), s * r, r),
                  even = fma(polynomial(s, even_series, 3), s * s, fma(s, v16(-0.5f), v16(1.0f)));
        const i16 k = __builtin_convertvector(n, i16) + quarters;
        return value(__builtin_bit_cast(i16, (k & 1) != 0 ? even : odd) ^ ((k & 2) << 30));
    }
    static bool large(v16 z) { return __builtin_reduce_max(abs(z)) > 8192.0f; }
    static v16 sin(v16 z) {
        if (!large(z)) return sine(z, 0);
        for (int i = 0; i < 16; ++i) z[i] = wp::sin(z[i]);
        return z;
    }
    static v16 cos(v16 z) {
        if (!large(z)) return sine(z, 1);
        for (int i = 0; i < 16; ++i) z[i] = wp::cos(z[i]);
        return z;
    }
};
