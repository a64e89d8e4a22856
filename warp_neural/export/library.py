"""Functions that shading languages lack, as statements. `bits_of` and `float_of` are floats as their bits and back."""

from warp_neural.export.statements import Function, Let, number

# of z^2, and of 2 / (2 + |z|) for what the exponential leaves: those of the CPU's `erf`, `coopvec/native/math.h`
ERF = (1.1283792, -0.37612626, 0.11283585, -0.026853812, 0.0051883276, -0.00080101932, 7.85386e-05)
TAIL = (-0.00015318748, 0.28489624, 0.25980172, 0.34736092, -0.10259424, 0.56187305, -0.4701517, 0.11901603)


def polynomial(x: str, coefficients: tuple[float, ...]) -> str:
    *rest, text = [number(c) for c in coefficients]
    for c in reversed(rest):
        text = f"({text} * {x} + {c})" if c[0] != "-" else f"({text} * {x} - {c[1:]})"
    return text


erf = Function(
    "erf",
    ("z",),
    (
        Let("a", "float", "abs(z)"),
        Let("s", "float", "z * z"),
        Let("t", "float", "2.0f / (2.0f + a)"),
        Let("far", "float", f"pick(a > 4.0f, 1.0f, 1.0f - exp(-s) * {polynomial('t', TAIL)})"),
    ),
    f"pick(a < 1.0f, z * {polynomial('s', ERF)}, pick(z < 0.0f, -far, far))",
)
to_half = Function(  # 65520 and more are infinite, 0x7f800000
    "to_half",
    ("z",),
    (
        Let("bits", "uint", "bits_of(z)"),
        Let("sign", "uint", "bits & 0x80000000u"),
        Let("size", "uint", "bits ^ sign"),
        Let("tiny", "float", "nearest(float_of(size) * 16777216.0f) * 5.9604645e-08f"),  # multiples of 2^-24
        Let("normal", "float", "float_of((size + 0xfffu + ((size >> 13u) & 1u)) & 0xffffe000u)"),
        Let("rounded", "float", "pick(size < 0x38800000u, tiny, normal)"),
        Let("large", "float", "float_of(0x7f800000u | sign)"),
        Let("finite", "float", "float_of(bits_of(rounded) | sign)"),
    ),
    "pick(size > 0x7f800000u, z, pick(size >= 0x477ff000u, large, finite))",
)
quartic = Function(
    "quartic",
    ("z",),
    (Let("u", "float", "min(max(z, -1.0f), 1.0f)"),),
    "0.5f + u * (0.9375f + u * u * (-0.625f + 0.1875f * u * u))",
)
tanh_of = Function("tanh_of", ("z",), (), "tanh(min(max(z, -12.0f), 12.0f))")  # some drivers' overflows
ALL = erf, to_half, quartic, tanh_of
