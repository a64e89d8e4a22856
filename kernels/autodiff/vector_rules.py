"""Forward derivatives of Warp's built-in functions that take vectors or matrices too.

Where two sides meet (abs, min, max, clamp) the side taken is that of Warp's adjoint; length and normalize have tangent
zero at zero, as there.
"""

import operator
from typing import Any

import warp as wp

from warp_neural.kernels.autodiff.rules import RULES, derivative_of, forward_mod

__all__ = ["RULES"]

Vector = wp.types.vector(length=Any, dtype=wp.Float)
Matrix = wp.types.matrix(shape=(Any, Any), dtype=wp.Float)
Quaternion = wp.types.quaternion(dtype=wp.Float)


@derivative_of(wp.abs)
@wp.func
def forward_abs(x: wp.Float, dx: wp.Float):
    return wp.abs(x), wp.where(x < type(x)(0.0), -dx, dx)


@wp.func
def forward_abs(x: Vector, dx: Vector):
    return wp.abs(x), wp.cw_mul(wp.sign(x), dx)


@derivative_of(wp.min)
@wp.func
def forward_min(a: wp.Float, b: wp.Float, da: wp.Float, db: wp.Float):
    return wp.min(a, b), wp.where(a < b, da, db)


@wp.func
def forward_min(a: Vector, b: Vector, da: Vector, db: Vector):
    tangent = db
    for i in range(len(a)):
        tangent[i] = wp.where(a[i] < b[i], da[i], db[i])
    return wp.min(a, b), tangent


@wp.func
def forward_min(a: Vector, da: Vector):
    return wp.min(a), da[int(wp.argmin(a))]


@derivative_of(wp.max)
@wp.func
def forward_max(a: wp.Float, b: wp.Float, da: wp.Float, db: wp.Float):
    return wp.max(a, b), wp.where(a > b, da, db)


@wp.func
def forward_max(a: Vector, b: Vector, da: Vector, db: Vector):
    tangent = db
    for i in range(len(a)):
        tangent[i] = wp.where(a[i] > b[i], da[i], db[i])
    return wp.max(a, b), tangent


@wp.func
def forward_max(a: Vector, da: Vector):
    return wp.max(a), da[int(wp.argmax(a))]


@derivative_of(wp.clamp)
@wp.func
def forward_clamp(x: wp.Float, low: wp.Float, high: wp.Float, dx: wp.Float, dlow: wp.Float, dhigh: wp.Float):
    larger = wp.max(low, x)
    tangent = wp.where(low > x, dlow, dx)
    return wp.min(larger, high), wp.where(larger < high, tangent, dhigh)


@derivative_of(wp.where)
@wp.func
def forward_where(condition: Any, a: Any, b: Any, dcondition: Any, da: Any, db: Any):
    return wp.where(condition, a, b), wp.where(condition, da, db)


@derivative_of(wp.lerp)
@wp.func
def forward_lerp(a: Any, b: Any, t: wp.Float, da: Any, db: Any, dt: wp.Float):
    return wp.lerp(a, b, t), wp.lerp(da, db, t) + (b - a) * dt


@derivative_of(wp.smoothstep)
@wp.func
def forward_smoothstep(a: wp.Float, b: wp.Float, x: wp.Float, da: wp.Float, db: wp.Float, dx: wp.Float):
    zero, one = type(x)(0.0), type(x)(1.0)
    t = wp.clamp((x - a) / (b - a), zero, one)
    slope = type(x)(6.0) * t * (one - t)  # of t, which moves with x and with both edges
    return wp.smoothstep(a, b, x), slope * (dx - (one - t) * da - t * db) / (b - a)


@derivative_of(wp.length)
@wp.func
def forward_length(v: Any, dv: Any):
    return wp.length(v), wp.dot(wp.normalize(v), dv)


@derivative_of(wp.length_sq)
@wp.func
def forward_length_sq(v: Any, dv: Any):
    return wp.length_sq(v), wp.dot(v, dv) + wp.dot(dv, v)


@derivative_of(wp.normalize)
@wp.func
def forward_normalize(v: Any, dv: Any):
    n = wp.normalize(v)
    length = wp.length(v)
    tangent = type(v)()
    if length > type(length)(0.0):
        tangent = (dv - n * wp.dot(n, dv)) / length
    return n, tangent


@derivative_of(operator.truediv)
@derivative_of(wp.div)
@wp.func
def forward_divide(a: Any, b: wp.Float, da: Any, db: wp.Float):
    quotient = a / b
    return quotient, (da - quotient * db) / b


@wp.func
def forward_divide(a: wp.Float, b: Vector, da: wp.Float, db: Vector):
    quotient = a / b
    return quotient, wp.cw_div(da * type(b)(b.dtype(1.0)) - wp.cw_mul(quotient, db), b)


@wp.func
def forward_divide(a: wp.Float, b: Matrix, da: wp.Float, db: Matrix):
    quotient = a / b
    return quotient, wp.cw_div(da * type(b)(b.dtype(1.0)) - wp.cw_mul(quotient, db), b)


@wp.func
def forward_divide(a: wp.Float, b: Quaternion, da: wp.Float, db: Quaternion):
    quotient = a / b
    tangent = db
    for i in range(4):
        tangent[i] = (da - quotient[i] * db[i]) / b[i]
    return quotient, tangent


@derivative_of(wp.cw_div)
@wp.func
def forward_cw_div(a: Any, b: Any, da: Any, db: Any):
    quotient = wp.cw_div(a, b)
    return quotient, wp.cw_div(da - wp.cw_mul(quotient, db), b)


@derivative_of(wp.inverse)
@wp.func
def forward_inverse(m: Matrix, dm: Matrix):
    inverse = wp.inverse(m)
    return inverse, -inverse * dm * inverse


@derivative_of(wp.determinant)
@wp.func
def forward_determinant(m: Matrix, dm: Matrix):
    determinant = wp.determinant(m)
    return determinant, determinant * wp.trace(wp.inverse(m) * dm)  # Jacobi's formula, for an invertible m


@wp.func
def forward_mod(a: Vector, b: Vector, da: Vector, db: Vector):
    tangent = da
    for i in range(len(a)):
        tangent[i] = da[i] - wp.trunc(a[i] / b[i]) * db[i]
    return wp.mod(a, b), tangent
