"""Activations: value and derivative as C expressions of the pre-activation `z`, the one text that all paths compile."""

from dataclasses import dataclass
from functools import cached_property

import warp as wp


@dataclass(frozen=True)
class Activation:
    """An elementwise activation h = f(z).

    `value` and `derivative` are C++ expressions of the float `z`; native code inlines them, each in parentheses that
    it is given here. `func` is the same as a differentiable `@wp.func` float -> float for Warp kernels.

    slope_at_result: the derivative as an expression of the result, here also called `z`, where that is enough: training
    then keeps results alone, and is faster.
    """

    name: str
    value: str
    derivative: str
    slope_at_result: str = ""

    def __post_init__(self):
        for name in ("value", "derivative", "slope_at_result"):
            if getattr(self, name):
                object.__setattr__(self, name, enclosed(getattr(self, name)))

    def __reduce__(self):  # copies and pickles leave the functions behind
        return type(self), (self.name, self.value, self.derivative, self.slope_at_result)

    @property
    def kept_slope(self) -> str:
        """The derivative at what training keeps: the result, or `z`."""
        return self.slope_at_result or self.derivative

    @cached_property
    def func(self) -> wp.Function:
        @wp.func_native(f"return {self.value};", adj_snippet=f"adj_z += adj_ret * ({self.derivative});")
        def activation(z: float) -> float: ...

        return activation

    @cached_property
    def slope(self) -> wp.Function:
        """The derivative as a `@wp.func` float -> float."""

        @wp.func_native(f"return {self.derivative};")
        def slope(z: float) -> float: ...

        return slope


def enclosed(expression: str) -> str:
    """In one pair of parentheses, so that it stays one operand wherever it is pasted."""
    depth, ends = 0, []  # where the parentheses are all closed again
    for i, letter in enumerate(expression):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        ends += [i] if depth == 0 else []
    return expression if ends == [len(expression) - 1] and len(expression) > 1 else f"({expression})"


SIGMOID = "(1.0f / (1.0f + wp::exp(-z)))"
NORMAL_CDF = "(0.5f + 0.5f * wp::erf(0.70710678f * z))"

linear = Activation("linear", "z", "1.0f", "1.0f")
relu = Activation("relu", "(z > 0.0f ? z : 0.0f)", "(z > 0.0f ? 1.0f : 0.0f)", "(z > 0.0f ? 1.0f : 0.0f)")
leaky_relu = Activation("leaky_relu", "(z > 0.0f ? z : 0.01f * z)", *2 * ("(z > 0.0f ? 1.0f : 0.01f)",))
elu = Activation(
    "elu", "(z > 0.0f ? z : wp::exp(z) - 1.0f)", "(z > 0.0f ? 1.0f : wp::exp(z))", "(z > 0.0f ? 1.0f : z + 1.0f)"
)  # Clevert et al. 2016, "Exponential Linear Units", eq. 16 with alpha 1
exponential = Activation("exponential", "wp::exp(z)", "wp::exp(z)")
shifted_exponential = Activation("shifted_exponential", "wp::exp(z - 3.0f)", "wp::exp(z - 3.0f)")
sigmoid = Activation("sigmoid", SIGMOID, f"{SIGMOID} * (1.0f - {SIGMOID})")
tanh = Activation("tanh", "wp::tanh(z)", "(1.0f - wp::tanh(z) * wp::tanh(z))")
silu = Activation("silu", f"z * {SIGMOID}", f"{SIGMOID} * (1.0f + z * (1.0f - {SIGMOID}))")
gelu = Activation("gelu", f"z * {NORMAL_CDF}", f"({NORMAL_CDF} + 0.39894228f * z * wp::exp(-0.5f * z * z))")
EXP = "wp::exp(-wp::abs(z))"  # of softplus; where it is small, the logarithm by its series: 1 + 1e-8 is 1
LOG = f"({EXP} < 1e-3f ? {EXP} * (1.0f - 0.5f * {EXP}) : wp::log(1.0f + {EXP}))"
softplus = Activation("softplus", f"(z > 0.0f ? z : 0.0f) + {LOG}", SIGMOID)
sine = Activation("sine", "wp::sin(z)", "wp::cos(z)")
ROOT = "wp::sqrt(z * z + 4.0f)"
squareplus = Activation(
    "squareplus",
    f"z > 0.0f ? 0.5f * (z + {ROOT}) : 2.0f / ({ROOT} - z)",  # one number, written without a difference
    f"z > 0.0f ? 0.5f + 0.5f * z / {ROOT} : 2.0f / (({ROOT} - z) * {ROOT})",
)  # Barron 2021, "Squareplus", with b = 4

ALL = (
    linear, relu, leaky_relu, elu, exponential, shifted_exponential, sigmoid, tanh, silu, gelu, softplus, sine,
    squareplus,
)  # fmt: skip
