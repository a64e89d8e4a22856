"""Directions by their values of the real spherical harmonics."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import factorial, pi, sqrt

from warp_neural.kernels.nn.encodings.base import Encoding, number, require_inputs, require_sizes

MAX_DEGREE = 8


@dataclass(frozen=True)
class SphericalHarmonics(Encoding):
    """The degree^2 real spherical harmonics of orders l below `degree`, 1 to 8, of a unit vector.

    Orthonormal on the sphere, result l^2 + l + m, signs as in tiny-cuda-nn: those of l = 1 are sqrt(3 / 4 pi) times
    -y, z, -x. The input is the vector itself, in [-1, 1]^3, where tiny-cuda-nn takes (x + 1) / 2. Off the sphere,
    and so in the gradient, they are K P(z) Re or Im (x + iy)^|m| with the polynomial P that holds on the sphere.
    """

    degree: int = 4

    def __post_init__(self):
        require_sizes(self, "degree", high=MAX_DEGREE)

    def n_out(self, n_in: int) -> int:
        require_inputs(self, n_in, 3, 3)  # of a direction
        return self.degree**2

    def encode_text(self, n_in: int, aligned: int) -> str:
        return self.powers() + "".join(
            f"out[{index}] = {polynomial(polar)} * {'c' if m >= 0 else 's'}{abs(m)};\n"
            for index, m, polar in self.terms()
        )

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        text = self.powers()
        for index, m, polar in self.terms():
            this, other, n = ("c", "s", m) if m >= 0 else ("s", "c", -m)
            text += f"d_in[2] += d_out[{index}] * {polynomial(derivative(polar))} * {this}{n};\n"
            if n:  # d(x + iy)^n / dx = n (x + iy)^(n - 1), and i times that in y
                sign = "-" if m > 0 else ""
                text += f"{{ const real d = d_out[{index}] * {n}.0f * {polynomial(polar)};\n"
                text += f"d_in[0] += d * {this}{n - 1}; d_in[1] += {sign}d * {other}{n - 1}; }}\n"
        return text

    def powers(self) -> str:
        """`c0`, `c1`, ... and `s0`, ...: real and imaginary parts of (x + iy)^m."""
        text = "const real x_ = in[0], y_ = in[1], z = in[2], zz = z * z, c0 = 1.0f, s0 = 0.0f;\n"
        for m in range(1, self.degree):
            real, imaginary = f"x_ * c{m - 1} - y_ * s{m - 1}", f"x_ * s{m - 1} + y_ * c{m - 1}"
            text += f"const real c{m} = {real}, s{m} = {imaginary};\n"
        return text

    def terms(self) -> Iterator[tuple[int, int, list[float]]]:
        """(index, m, coefficients in z) of each harmonic: the normalised m-th derivative of P_l."""
        for l in range(self.degree):
            for m in range(-l, l + 1):
                n = abs(m)
                norm = sqrt((2 * l + 1) / (4 * pi) * factorial(l - n) / factorial(l + n) * (2 if n else 1))
                polar = legendre(l)
                for _ in range(n):
                    polar = derivative(polar)
                yield l * l + l + m, m, [(-1) ** n * norm * c for c in polar]


def legendre(l: int) -> list[float]:
    """Coefficients of P_l, constant first, by Bonnet's recursion."""
    previous, this = [0.0], [1.0]
    for n in range(1, l + 1):
        raised = [0.0, *((2 * n - 1) / n * c for c in this)]
        lowered = [(n - 1) / n * c for c in previous] + [0.0] * (len(raised) - len(previous))
        previous, this = this, [a - b for a, b in zip(raised, lowered, strict=True)]
    return this


def derivative(coefficients: list[float]) -> list[float]:
    return [power * c for power, c in enumerate(coefficients)][1:] or [0.0]


def polynomial(coefficients: list[float]) -> str:
    """C++ of an even or odd polynomial of `z`; `zz` is its square."""
    odd = len(coefficients) % 2 == 0
    *rest, text = [number(c) for c in coefficients[odd::2]]
    for c in reversed(rest):
        text = f"({text} * zz + {c})"
    return f"z * {text}" if odd else text
