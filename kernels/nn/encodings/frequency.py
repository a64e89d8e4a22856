"""Encodings without parameters, of each input by itself: as it is, by sines and cosines, by triangle waves."""

from dataclasses import dataclass

from warp_neural.kernels.errors import is_finite, require
from warp_neural.kernels.native import both
from warp_neural.kernels.nn.encodings.base import Encoding, number, numbers, require_sizes

# sin and cos of pi (q + r) for integer q, |r| <= 1/2: least maximum errors, 3e-9 and 5e-8. Both take the sign (-1)^q
SINE = (3.141592580044165, -5.16770687889041, 2.5500313766743026, -0.5980451704200082, 0.07722012153830903)
COSINE = (0.9999999534662694, -4.934792858611434, 4.058411912634429, -1.3318801498010617, 0.2196967724305555)


@dataclass(frozen=True)
class Identity(Encoding):
    """The inputs as they are."""

    def n_out(self, n_in: int) -> int:
        return n_in

    def encode_text(self, n_in: int, aligned: int) -> str:
        return f"for (int i = 0; i < {n_in}; ++i) out[i] = in[i];\n"

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        return f"for (int i = 0; i < {n_in}; ++i) d_in[i] += d_out[i];\n"


@dataclass(frozen=True)
class TriangleWave(Encoding):
    """Triangle waves of x with periods 2, 1, 1/2, ...: `octaves` of each input (Mueller et al. 2021, NRC).

    Wave k is 4 |t - floor(t) - 1/2| - 1 of t = 2^(k - 1) x + k / 4, as in tiny-cuda-nn: each is a quarter of a period
    ahead of the one before. Results go by input, then by octave.
    """

    octaves: int = 12

    def __post_init__(self):
        require_sizes(self, "octaves", high=24)  # float32 holds no more

    def n_out(self, n_in: int) -> int:
        return self.octaves * n_in

    def encode_text(self, n_in: int, aligned: int) -> str:
        return self.for_each(n_in, "out[at] = 4.0f * wp::abs(t) - 1.0f;")

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        return self.for_each(n_in, "d_in[i] += d_out[at] * (t < 0.0f ? -4.0f : 4.0f) * f;")

    def for_each(self, n_in: int, use: str) -> str:
        """`use` with `t` in [-1/2, 1/2) for each input i and octave k."""
        return f"""
#pragma unroll
for (int i = 0; i < {n_in}; ++i)
#pragma unroll
for (int k = 0; k < {self.octaves}; ++k) {{
    const real f = 0.5f * static_cast<real>(1u << k), turns = in[i] * f + 0.25f * static_cast<real>(k % 4);
    const real t = turns - wp::floor(turns) - 0.5f;
    const int at = i * {self.octaves} + k;
    {use}
}}
"""


@dataclass(frozen=True)
class Frequency(Encoding):
    """sin and cos of pi `lowest` 2^k x for k = 0 ... `octaves` - 1 (NeRF; Mildenhall et al. 2020, eq. 4).

    Results go by input, then by octave, sine before cosine: 2 * octaves of each input. `lowest` counts half turns in a
    unit of x: 1 has period 2, as in tiny-cuda-nn and RTXNS; 2 has period 1, as in the course, so that x = 0 and x = 1
    encode alike. Angles are reduced before pi enters, so large x lose nothing beyond the rounding of x itself.
    """

    octaves: int = 4
    lowest: float = 1.0

    def __post_init__(self):
        require_sizes(self, "octaves", high=64)
        valid = is_finite(self.lowest) and self.lowest > 0
        require(valid, "Frequency: lowest", self.lowest, "a positive number of half turns")

    def n_out(self, n_in: int) -> int:
        return 2 * self.octaves * n_in

    def frequencies(self) -> list[float]:
        """In half turns a unit."""
        return [self.lowest * 2**k for k in range(self.octaves)]

    def encode_text(self, n_in: int, aligned: int) -> str:
        return self.for_each(
            n_in,
            "__builtin_memcpy(out + 2 * first, &pairs, 8 * count);",
            "out[2 * i] = sine; out[2 * i + 1] = cosine;",
        )

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        return self.for_each(
            n_in,
            f"""#pragma unroll
for (int lane = 0; lane < count; ++lane) {{
    const int i = first + lane;
    const real slope = d_out[2 * i] * pairs[2 * lane + 1] - d_out[2 * i + 1] * pairs[2 * lane];
    d_in[i / {self.octaves}] += 3.14159265f * frequency[lane] * slope;
}}""",
            f"d_in[i / {self.octaves}] += 3.14159265f * f * (d_out[2 * i] * cosine - d_out[2 * i + 1] * sine);",
        )

    def for_each(self, n_in: int, use_group: str, use: str) -> str:
        """CPU: `use_group` for each group of angles, `count` of them from number `first` on. CUDA: `use` for each."""
        return both(self.groups(n_in, use_group), self.angles(n_in, use))

    def groups(self, n_in: int, use: str) -> str:
        """`pairs`, sine and cosine in turn, and their `frequency`."""
        total = n_in * self.octaves
        lanes = min(16, max(2, 1 << (total - 1).bit_length()))
        text = f"typedef real vec __attribute__((ext_vector_type({lanes})));\n"
        text += f"typedef wp::int32 ivec __attribute__((ext_vector_type({lanes})));\n"
        for first in range(0, total, lanes):
            count = min(lanes, total - first)
            padding = ["0.0f"] * (lanes - count)
            angles = range(first, first + count)
            inputs = [f"in[{i // self.octaves}]" for i in angles]
            frequencies = [number(self.frequencies()[i % self.octaves]) for i in angles]
            order = ", ".join(f"{i}, {i + lanes}" for i in range(lanes))
            text += f"""{{
const int first = {first}, count = {count};
const vec x_lanes = {{{", ".join(inputs + padding)}}}, frequency = {{{", ".join(frequencies + padding)}}};
const vec h = x_lanes * frequency, whole = __builtin_elementwise_roundeven(h), r = h - whole, s = r * r;
const vec flip = 1.0f - 2.0f * __builtin_elementwise_abs(whole - 2.0f * __builtin_elementwise_roundeven(0.5f * whole));
const vec sine = flip * r * ({horner(SINE)}), cosine = flip * ({horner(COSINE)});
const auto pairs = __builtin_shufflevector(sine, cosine, {order});
{use}
}}
"""
        return text

    def angles(self, n_in: int, use: str) -> str:
        total = n_in * self.octaves
        return f"""
const real frequencies[{self.octaves}] = {{{numbers(self.frequencies())}}};
#pragma unroll
for (int i = 0; i < {total}; ++i) {{
    const real f = frequencies[i % {self.octaves}], h = in[i / {self.octaves}] * f;
    real sine, cosine;
    __sincosf(3.14159265f * (h - 2.0f * rintf(0.5f * h)), &sine, &cosine);
    {use}
}}
"""


def horner(coefficients: tuple[float, ...]) -> str:
    """The polynomial of `s`, lowest coefficient first."""
    text = number(coefficients[-1])
    for c in reversed(coefficients[:-1]):
        text = f"({text} * s + {number(c)})"
    return text
