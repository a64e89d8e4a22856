"""Functions of 16 floats at a time for CPU text, as compilers have none: those that activations call.

Within 4 units in the last place of float32 (erf; all others 2) where the result is not near a zero far from z = 0, and
as the library's for what is not finite. Reductions and their constants: Cody and Waite 1980, "Software Manual for the
Elementary Functions"; the polynomials were fitted to the smallest relative error (iteratively reweighted least
squares).
"""

import re


def polynomial(x: str, *coefficients: float) -> str:
    """From the constant up, by Horner's rule."""
    text = f"v16({coefficients[-1]!r}f)"
    for c in reversed(coefficients[:-1]):
        text = f"__builtin_elementwise_fma({text}, {x}, v16({c!r}f))"
    return text


EXP = polynomial("r", 0.5, 0.16666577, 0.041666853, 0.00836314, 0.0013901284)
LOG = polynomial(
    "t", 0.33333331, -0.24999994, 0.20000715, -0.16668058, 0.14249323, -0.12420144, 0.11677003, -0.11514591, 0.070376481
)
TANH = polynomial("s", -0.33333329, 0.13332768, -0.0538508, 0.020996831, -0.0060963448)
SIN = polynomial("s", -0.16666665, 0.0083327418, -0.00019586953)
COS = polynomial("s", 0.041666664, -0.0013888269, 2.4543520e-05)
ERF = polynomial("s", 1.1283792, -0.37612626, 0.11283585, -0.026853812, 0.0051883276, -0.00080101932, 7.8538600e-05)
ERFCX = polynomial(
    "t", -0.00015318748, 0.28489624, 0.25980172, 0.34736092, -0.10259424, 0.56187305, -0.4701517, 0.11901603
)

MATH = f"""
typedef int i16 __attribute__((ext_vector_type(16)));
struct Math {{
static v16 value(i16 b) {{ return __builtin_bit_cast(v16, b); }}
static v16 fma(v16 x, v16 y, v16 z) {{ return __builtin_elementwise_fma(x, y, z); }}
static v16 abs(v16 z) {{ return __builtin_elementwise_abs(z); }}
static v16 sqrt(v16 z) {{ return __builtin_elementwise_sqrt(z); }}
// whole numbers from -2^22 to 2^22
static v16 nearest(v16 z) {{ return (z + 12582912.0f) - 12582912.0f; }}
static v16 exp(v16 z) {{
    z = z < -104.0f ? v16(-104.0f) : z > 89.0f ? v16(89.0f) : z;  // 0 and infinity
    const v16 n = nearest(z * 1.44269504f);
    const v16 r = fma(n, v16(2.12194440e-4f), fma(n, v16(-0.693359375f), z));
    const i16 k = __builtin_convertvector(n, i16), half = k >> 1;
    return fma({EXP}, r * r, r + 1.0f) * value((half + 127) << 23) * value((k - half + 127) << 23);
}}
static v16 log(v16 z) {{
    const v16 x = z < 1.17549435e-38f ? z * 8388608.0f : z;
    const i16 bits = __builtin_bit_cast(i16, x), e = (bits - 0x3f3504f3) >> 23;  // m from sqrt(0.5) to sqrt(2)
    const v16 t = value(bits - (e << 23)) - 1.0f;
    const v16 n = __builtin_convertvector(e, v16) - (z < 1.17549435e-38f ? v16(23.0f) : v16(0.0f));
    v16 y = fma({LOG}, t * t * t, n * -2.12194440e-4f);
    y = fma(n, v16(0.693359375f), fma(t * t, v16(-0.5f), y) + t);
    y = z == 0.0f ? v16(-__builtin_inff()) : z < 0.0f ? v16(__builtin_nanf("")) : y;
    return z < __builtin_inff() ? y : z;
}}
static v16 tanh(v16 z) {{
    const v16 a = abs(z), s = z * z, e = exp(2.0f * a), far = 1.0f - 2.0f / (e + 1.0f);
    return a < 0.625f ? fma({TANH}, s * z, z) : __builtin_elementwise_copysign(far, z);
}}
static v16 erf(v16 z) {{
    const v16 a = abs(z), s = z * z, t = 2.0f / (2.0f + a), far = 1.0f - exp(-s) * ({ERFCX});
    return a < 1.0f ? z * ({ERF}) : __builtin_elementwise_copysign(a > 4.0f ? v16(1.0f) : far, z);
}}
static v16 sine(v16 z, int quarters) {{
    const v16 n = nearest(z * 0.636619772f);
    const v16 r = fma(n, v16(-7.54978942e-8f), fma(n, v16(-4.83751297e-4f), fma(n, v16(-1.5703125f), z)));
    const v16 s = r * r, odd = fma({SIN}, s * r, r), even = fma({COS}, s * s, fma(s, v16(-0.5f), v16(1.0f)));
    const i16 k = __builtin_convertvector(n, i16) + quarters;
    return value(__builtin_bit_cast(i16, (k & 1) != 0 ? even : odd) ^ ((k & 2) << 30));
}}
static bool large(v16 z) {{ return __builtin_reduce_max(abs(z)) > 8192.0f; }}
static v16 sin(v16 z) {{
    if (!large(z)) return sine(z, 0);
    for (int i = 0; i < 16; ++i) z[i] = wp::sin(z[i]);
    return z;
}}
static v16 cos(v16 z) {{
    if (!large(z)) return sine(z, 1);
    for (int i = 0; i < 16; ++i) z[i] = wp::cos(z[i]);
    return z;
}}
}};
"""
FUNCTIONS = {"exp", "log", "tanh", "erf", "sin", "cos", "sqrt", "abs"}


def on_vectors(expression: str) -> str | None:
    """An activation's expression of 16 floats `z`, after `MATH` if it calls functions; None if it calls others."""
    calls = set(re.findall(r"wp::(\w+)", expression))
    return expression.replace("wp::", "Math::") if calls <= FUNCTIONS else None
