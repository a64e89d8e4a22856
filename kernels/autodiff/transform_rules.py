"""Forward derivatives of Warp's built-in functions of quaternions and rigid transformations, of any length."""

from typing import Any

import warp as wp

from warp_neural.kernels.autodiff.rules import derivative_of, zero
from warp_neural.kernels.autodiff.vector_rules import RULES, Matrix, Vector

__all__ = ["RULES"]

Transformation = wp.types.transformation(dtype=wp.Float)


@derivative_of(wp.quat_rotate)
@wp.func
def forward_quat_rotate(q: Any, v: Vector, dq: Any, dv: Vector):
    """The value is v (2 w^2 - 1) + 2 u (u . v) + 2 w u x v, as Warp computes it for a q of any length."""
    two = v.dtype(2.0)
    u, du = type(v)(q[0], q[1], q[2]), type(v)(dq[0], dq[1], dq[2])
    w, dw = q[3], dq[3]
    tangent = wp.quat_rotate(q, dv) + two * (
        two * w * dw * v + wp.cross(u, v) * dw + wp.cross(du, v) * w + du * wp.dot(u, v) + u * wp.dot(du, v)
    )
    return wp.quat_rotate(q, v), tangent


@derivative_of(wp.quat_rotate_inv)
@wp.func
def forward_quat_rotate_inv(q: Any, v: Vector, dq: Any, dv: Vector):
    _value, tangent = forward_quat_rotate(wp.quat_inverse(q), v, wp.quat_inverse(dq), dv)
    return wp.quat_rotate_inv(q, v), tangent


@derivative_of(wp.quat_to_matrix)
@wp.func
def forward_quat_to_matrix(q: Any, dq: Any):
    """Its columns are the turned axes."""
    matrix = wp.quat_to_matrix(q)
    tangent = matrix
    column = matrix[0]
    for i in range(3):
        axis = type(column)()
        axis[i] = q.dtype(1.0)
        _turned, column = forward_quat_rotate(q, axis, dq, type(column)())
        for k in range(3):
            tangent[k, i] = column[k]
    return matrix, tangent


@derivative_of(wp.quat_from_axis_angle)
@wp.func
def forward_quat_from_axis_angle(axis: Vector, angle: wp.Float, daxis: Vector, dangle: wp.Float):
    half = type(angle)(0.5)
    q = wp.quat_from_axis_angle(axis, angle)
    s, c = wp.sin(half * angle), wp.cos(half * angle)
    tangent = type(q)(daxis * s + axis * (half * c * dangle), -half * s * dangle)
    return q, tangent


@derivative_of(wp.transform_multiply)
@wp.func
def forward_transform_multiply(a: Any, b: Any, da: Any, db: Any):
    """(p_a + R(q_a) p_b, q_a q_b)"""
    qa, qb = wp.transform_get_rotation(a), wp.transform_get_rotation(b)
    dqa, dqb = wp.transform_get_rotation(da), wp.transform_get_rotation(db)
    _turned, dp = forward_quat_rotate(qa, wp.transform_get_translation(b), dqa, wp.transform_get_translation(db))
    return wp.transform_multiply(a, b), type(a)(dp + wp.transform_get_translation(da), dqa * qb + qa * dqb)


@derivative_of(wp.transform_inverse)
@wp.func
def forward_transform_inverse(t: Any, dt: Any):
    """(-R(q^-1) p, q^-1)"""
    dq = wp.quat_inverse(wp.transform_get_rotation(dt))
    _turned, dp = forward_quat_rotate(
        wp.quat_inverse(wp.transform_get_rotation(t)),
        wp.transform_get_translation(t),
        dq,
        wp.transform_get_translation(dt),
    )
    return wp.transform_inverse(t), type(t)(-dp, dq)


@derivative_of(wp.transform_vector)
@wp.func
def forward_transform_vector(t: Transformation, v: Vector, dt: Transformation, dv: Vector):
    return forward_quat_rotate(wp.transform_get_rotation(t), v, wp.transform_get_rotation(dt), dv)


@wp.func
def forward_transform_vector(m: Matrix, v: Vector, dm: Matrix, dv: Vector):
    return wp.transform_vector(m, v), wp.transform_vector(dm, v) + wp.transform_vector(m, dv)


@derivative_of(wp.transform_point)
@wp.func
def forward_transform_point(t: Transformation, v: Vector, dt: Transformation, dv: Vector):
    _turned, tangent = forward_quat_rotate(wp.transform_get_rotation(t), v, wp.transform_get_rotation(dt), dv)
    return wp.transform_point(t, v), tangent + wp.transform_get_translation(dt)


@wp.func
def forward_transform_point(m: Matrix, v: Vector, dm: Matrix, dv: Vector):
    return wp.transform_point(m, v), wp.transform_point(dm, v) + wp.transform_vector(m, dv)


@wp.func
def left_of_product(a: Transformation, b: Transformation, da: Transformation):
    """The tangent of a * b along that of a; not da * b where a product is not linear in a."""
    _product, tangent = forward_transform_multiply(a, b, da, zero(b))
    return tangent


@wp.func
def left_of_product(a: Any, b: Any, da: Any):
    return da * b


@wp.func
def right_of_product(a: Transformation, b: Transformation, db: Transformation):
    _product, tangent = forward_transform_multiply(a, b, zero(a), db)
    return tangent


@wp.func
def right_of_product(a: Any, b: Any, db: Any):
    return a * db
