"""Forward derivatives of Warp's built-in functions of scalars: (arguments, tangents) -> (value, tangent).

`RULES` holds them; `derivatives_vector` adds those that take vectors and matrices too.
"""

import builtins
import operator
from collections.abc import Callable
from typing import Any

import warp as wp


@wp.func
def zero(x: wp.Scalar):
    return type(x)(0)


@wp.func
def zero(x: bool):
    return False


@wp.func
def zero(x: Any):
    """Of the type of x: vector, matrix or struct."""
    return type(x)()


# The tangent is the function itself: of the tangents; of each tangent with the other argument, summed; zero.
LINEAR = {
    wp.float16, wp.float32, wp.float64, builtins.float, wp.degrees, wp.radians, wp.add, wp.sub,
    wp.neg, wp.pos, wp.copy, wp.matrix_from_cols, wp.matrix_from_rows, wp.transpose, wp.trace, wp.diag, wp.get_diag,
    wp.skew, wp.quat_inverse, wp.transform_get_rotation, wp.transform_get_translation, wp.spatial_top,
    wp.spatial_bottom,
}  # fmt: skip
PRODUCTS = {
    wp.dot, wp.ddot, wp.cross, wp.outer, wp.cw_mul, wp.spatial_dot, wp.spatial_cross, wp.spatial_cross_dual,
}  # fmt: skip
CONSTANT = {
    wp.int8, wp.int16, wp.int32, wp.int64, wp.uint8, wp.uint16, wp.uint32, wp.uint64, builtins.int, builtins.bool,
    wp.sign, wp.step, wp.nonzero, wp.round, wp.rint, wp.trunc, wp.floor, wp.ceil, wp.isfinite, wp.isnan, wp.isinf,
    wp.argmin, wp.argmax, wp.floordiv, wp.static, builtins.len, builtins.range, builtins.type, zero,
}  # fmt: skip

RULES: dict[Callable, wp.Function] = {}


def derivative_of(function: Callable) -> Callable[[wp.Function], wp.Function]:
    """Register the decorated function as the forward derivative of a Warp function or an operator."""

    def register(rule: wp.Function) -> wp.Function:
        RULES[function] = rule
        return rule

    return register


@derivative_of(wp.sin)
@wp.func
def forward_sin(x: wp.Float, dx: wp.Float):
    return wp.sin(x), wp.cos(x) * dx


@derivative_of(wp.cos)
@wp.func
def forward_cos(x: wp.Float, dx: wp.Float):
    return wp.cos(x), -wp.sin(x) * dx


@derivative_of(wp.tan)
@wp.func
def forward_tan(x: wp.Float, dx: wp.Float):
    y = wp.tan(x)
    return y, (type(x)(1.0) + y * y) * dx


@derivative_of(wp.asin)
@wp.func
def forward_asin(x: wp.Float, dx: wp.Float):
    return wp.asin(x), dx / wp.sqrt(type(x)(1.0) - x * x)


@derivative_of(wp.acos)
@wp.func
def forward_acos(x: wp.Float, dx: wp.Float):
    return wp.acos(x), -dx / wp.sqrt(type(x)(1.0) - x * x)


@derivative_of(wp.atan)
@wp.func
def forward_atan(x: wp.Float, dx: wp.Float):
    return wp.atan(x), dx / (type(x)(1.0) + x * x)


@derivative_of(wp.atan2)
@wp.func
def forward_atan2(y: wp.Float, x: wp.Float, dy: wp.Float, dx: wp.Float):
    return wp.atan2(y, x), (x * dy - y * dx) / (x * x + y * y)


@derivative_of(wp.sinh)
@wp.func
def forward_sinh(x: wp.Float, dx: wp.Float):
    return wp.sinh(x), wp.cosh(x) * dx


@derivative_of(wp.cosh)
@wp.func
def forward_cosh(x: wp.Float, dx: wp.Float):
    return wp.cosh(x), wp.sinh(x) * dx


@derivative_of(wp.tanh)
@wp.func
def forward_tanh(x: wp.Float, dx: wp.Float):
    y = wp.tanh(x)
    return y, (type(x)(1.0) - y * y) * dx


@derivative_of(wp.exp)
@wp.func
def forward_exp(x: wp.Float, dx: wp.Float):
    y = wp.exp(x)
    return y, y * dx


@derivative_of(wp.log)
@wp.func
def forward_log(x: wp.Float, dx: wp.Float):
    return wp.log(x), dx / x


@derivative_of(wp.log2)
@wp.func
def forward_log2(x: wp.Float, dx: wp.Float):
    return wp.log2(x), dx / (x * type(x)(0.6931471805599453))


@derivative_of(wp.log10)
@wp.func
def forward_log10(x: wp.Float, dx: wp.Float):
    return wp.log10(x), dx / (x * type(x)(2.302585092994046))


@derivative_of(wp.sqrt)
@wp.func
def forward_sqrt(x: wp.Float, dx: wp.Float):
    y = wp.sqrt(x)
    return y, type(x)(0.5) * dx / y


@derivative_of(wp.cbrt)
@wp.func
def forward_cbrt(x: wp.Float, dx: wp.Float):
    y = wp.cbrt(x)
    return y, dx / (type(x)(3.0) * y * y)


@derivative_of(wp.erf)
@wp.func
def forward_erf(x: wp.Float, dx: wp.Float):
    return wp.erf(x), type(x)(1.1283791670955126) * wp.exp(-x * x) * dx  # 2 / sqrt(pi)


@derivative_of(wp.erfc)
@wp.func
def forward_erfc(x: wp.Float, dx: wp.Float):
    return wp.erfc(x), type(x)(-1.1283791670955126) * wp.exp(-x * x) * dx


@derivative_of(wp.erfinv)
@wp.func
def forward_erfinv(x: wp.Float, dx: wp.Float):
    y = wp.erfinv(x)
    return y, type(x)(0.8862269254527580) * wp.exp(y * y) * dx  # sqrt(pi) / 2


@derivative_of(wp.erfcinv)
@wp.func
def forward_erfcinv(x: wp.Float, dx: wp.Float):
    y = wp.erfcinv(x)
    return y, type(x)(-0.8862269254527580) * wp.exp(y * y) * dx


@derivative_of(wp.copysign)
@wp.func
def forward_copysign(x: wp.Float, y: wp.Float, dx: wp.Float, dy: wp.Float):
    """dx where x and y have one sign, else -dx; a step along y."""
    one = type(x)(1.0)
    return wp.copysign(x, y), wp.copysign(one, x) * wp.copysign(one, y) * dx


@derivative_of(operator.pow)
@derivative_of(wp.pow)
@wp.func
def forward_pow(x: wp.Float, y: wp.Float, dx: wp.Float, dy: wp.Float):
    p = wp.pow(x, y)
    tangent = type(x)(0.0)
    if dx != tangent:  # no 0 * inf at 0, no logarithm of a negative number, where that part plays no role
        tangent += y * wp.pow(x, y - type(x)(1.0)) * dx
    if dy != type(x)(0.0):
        tangent += p * wp.log(x) * dy
    return p, tangent


@derivative_of(operator.mod)
@derivative_of(wp.mod)
@wp.func
def forward_mod(a: wp.Float, b: wp.Float, da: wp.Float, db: wp.Float):
    return wp.mod(a, b), da - wp.trunc(a / b) * db


@derivative_of(wp.frac)
@wp.func
def forward_frac(x: wp.Float, dx: wp.Float):
    return wp.frac(x), dx
