"""`debug_grad`: the identity, whose backward shows the gradient that passes."""

import warp as wp

TYPES = (
    wp.float32, wp.float64, wp.vec2, wp.vec3, wp.vec4, wp.vec2d, wp.vec3d, wp.vec4d,
)  # fmt: skip


def add_printing(value: type, debug_grad: wp.Function | None) -> wp.Function:
    """`debug_grad` with one more overload, `(x: value) -> value`; Warp finds the others in this scope."""

    @wp.func
    def debug_grad(x: value):
        return x

    @wp.func_grad(debug_grad)
    def adj_debug_grad(x: value, adj_ret: value):
        print(adj_ret)
        wp.adjoint[x] += adj_ret

    return debug_grad


def add_recording(value: type, debug_grad: wp.Function) -> wp.Function:
    """The same for `(x: value, record: wp.array[value], i: int) -> value`."""

    @wp.func
    def debug_grad(x: value, record: wp.array[value], i: int):
        return x

    @wp.func_grad(debug_grad)
    def adj_debug_grad(x: value, record: wp.array[value], i: int, adj_ret: value):
        wp.atomic_add(record, i, adj_ret)
        wp.adjoint[x] += adj_ret

    return debug_grad


debug_grad = None
for value in TYPES:
    debug_grad = add_recording(value, add_printing(value, debug_grad))
