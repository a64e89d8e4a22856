"""Derivatives of Warp functions: forward mode, loops in reverse mode, checks, a look at the gradients that pass.

Warp differentiates backwards: one pass gives the derivatives of one result along all arguments. Forward mode gives the
derivatives of all results along one direction, the product of the Jacobian and a vector: normals of a distance field,
velocities, sensitivities to a few parameters. It needs no tape, follows loops of any length, and what it makes is an
ordinary `@wp.func`: it may be differentiated again, in either mode.

Backwards, Warp 1.19 gets loops wrong that carry a state from trip to trip: `loop` makes them with a right gradient, and
`check` compares a kernel's gradients with finite differences.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from warp_neural.autodiff.differences import check
from warp_neural.autodiff.forward import make_forward
from warp_neural.autodiff.loops import loop
from warp_neural.autodiff.source import Source, define, differentiable
from warp_neural.errors import InputError
from warp_neural.kernels.autodiff.debug import debug_grad
from warp_neural.kernels.autodiff.transform_rules import RULES

__all__ = ["check", "check_finite", "debug_grad", "forward_derivative", "jvp", "loop", "make_jvp"]


def make_jvp(func: wp.Function) -> wp.Function:
    """The forward derivative of a `@wp.func` as a function for kernels.

        square_jvp = wn.autodiff.make_jvp(square)  # outside of the kernel
        value, tangent = square_jvp(x, y, dx, dy)  # inside

    It takes the arguments of `func` and then, each of its argument's type, the tangents of those that have one: floats,
    vectors, matrices and quaternions of floats, structs that hold one of these. Integers, booleans and arrays have
    none. It returns the results of `func` and then their tangents; the tangent of an integer result is zero.

    Followed: arithmetic, branches, loops of any length, calls of other `@wp.func`s, most built-in functions of scalars,
    vectors and matrices. Not followed: what is written to an array and what is read from one count as constant.
    Raises `InputError` for a built-in or native function without a known derivative: see `forward_derivative`.
    """
    if not isinstance(func, wp.Function) or (func.is_builtin() and func not in RULES):
        raise InputError(f"jvp of {func!r}: expected a function decorated with @wp.func")
    if func in RULES:
        return RULES[func]
    active = _has_tangent(func)
    if not any(active):
        raise InputError(f"jvp of {func.key}: none of its arguments is a float, a vector of floats or a struct of them")
    result = make_forward(func, active)
    if Source(func, active).count_results() == 0:
        raise InputError(f"jvp of {func.key}: it returns nothing")
    return result


def forward_derivative(func: wp.Function) -> Callable[[wp.Function], wp.Function]:
    """Decorator: use this `@wp.func` as the forward derivative of `func`, here and wherever `func` is called.

        @wn.autodiff.forward_derivative(cube)
        @wp.func
        def cube_forward(x: float, dx: float):
            return x * x * x, 3.0 * x * x * dx

    It has the signature that `make_jvp` describes. `func` may be a native or a built-in function; of a built-in one
    every argument has a tangent. Register before the first use of `func` in another function's `make_jvp`.
    """

    def register(rule: wp.Function) -> wp.Function:
        expected = len(func.input_types) + sum(_has_tangent(func))
        if not func.is_builtin() and len(rule.input_types) != expected:
            raise InputError(
                f"forward derivative {rule.key} of {func.key}: it takes {len(rule.input_types)} arguments; expected "
                f"{expected}, those of {func.key} and a tangent of each that has one"
            )
        RULES[func] = rule
        make_forward.cache_clear()
        return rule

    return register


def jvp(func: wp.Function, primals: Sequence, tangents: Sequence, *, device: wp.DeviceLike = None) -> tuple[Any, Any]:
    """`(value, derivative)` of a `@wp.func` at `primals` along `tangents`.

    `tangents` has one entry for each of `primals`, of the same type; None holds that argument constant, and is what
    integers, booleans and arrays take. Of a function with several results both value and derivative are tuples.

    For many points at once pass one-dimensional arrays of equal length for arguments that are not arrays (and for their
    tangents); then value and derivative are arrays too. Runs on the device of these arrays, else on `device`, in one
    launch, which no tape records: to differentiate further call `make_jvp(func)` in a kernel of your own.
    """
    function = make_jvp(func)
    if not len(primals) == len(tangents) == len(func.input_types):
        raise InputError(
            f"jvp of {func.key}: {len(primals)} primals and {len(tangents)} tangents; expected {len(func.input_types)} "
            "each, None for arguments without a tangent"
        )
    arguments = [*primals, *_given_tangents(func, primals, tangents)]
    annotations = function.input_types.values()
    mapped = tuple(
        isinstance(a, wp.array) and not wp.types.is_array(t) for a, t in zip(arguments, annotations, strict=True)
    )
    arrays = [a for a, is_mapped in zip(arguments, mapped, strict=True) if is_mapped]
    if len({a.shape for a in arrays}) > 1 or any(a.ndim != 1 for a in arrays):
        raise InputError(f"jvp of {func.key}: arrays of shapes {[a.shape for a in arrays]}; expected [n] for all")
    device = arrays[0].device if arrays else wp.get_device(device)
    kernel, results = _make_kernel(function, tuple(map(_element_type, arguments, annotations)), mapped)
    outputs = [wp.empty(len(arrays[0]) if arrays else 1, dtype=r, device=device) for r in results]
    wp.launch(kernel, len(outputs[0]), inputs=arguments, outputs=outputs, device=device, record_tape=False)
    values = outputs if arrays else [output.list()[0] for output in outputs]
    half = len(values) // 2
    return (values[0], values[1]) if half == 1 else (tuple(values[:half]), tuple(values[half:]))


def check_finite(record: wp.array) -> None:
    """Raise `FloatingPointError`, naming index and value, at the first gradient in `record` that is not finite.

    For a `record` that `debug_grad` filled; it waits for the device.
    """
    values = record.numpy()
    bad = np.argwhere(~np.isfinite(values.reshape(len(record), -1)).all(axis=1))
    if len(bad):
        index = int(bad[0, 0])
        raise FloatingPointError(f"gradient {index} is {values[index]}; {len(bad)} of {len(record)} are not finite")


def _has_tangent(func: wp.Function) -> tuple[bool, ...]:
    return tuple(differentiable(type_) for type_ in func.input_types.values())


def _given_tangents(func: wp.Function, primals: Sequence, tangents: Sequence) -> list:
    """Those that `make_jvp(func)` takes, zeros for None."""
    given = []
    names = func.input_types
    for name, has_tangent, primal, tangent in zip(names, _has_tangent(func), primals, tangents, strict=True):
        if has_tangent:
            given.append(_element_type(primal, names[name])() if tangent is None else tangent)
        elif tangent is not None:
            raise InputError(f"jvp of {func.key}: argument {name} has no derivative; its tangent must be None")
    return given


def _element_type(value: Any, annotation: Any) -> Any:
    """The type that one thread gets."""
    if isinstance(value, wp.array) and not wp.types.is_array(annotation):
        return value.dtype
    return type(value) if annotation in (Any, wp.Float) else annotation


@cache
def _make_kernel(function: wp.Function, types: tuple, mapped: tuple[bool, ...]) -> tuple[wp.Kernel, list]:
    """A kernel of one thread for each element of the `mapped` arguments, and the types of its outputs."""
    overload = function.get_overload(list(types), {})
    if overload is None:
        expected = ", ".join(map(wp.types.type_repr, function.input_types.values()))
        raise InputError(f"jvp of {function.key}: it takes ({expected})")
    if overload.value_func is None:
        overload.build(None)
    results = overload.value_func(dict(zip(overload.input_types, types, strict=True)), None)
    inputs = {f"x{i}": wp.array[t] if m else t for i, (t, m) in enumerate(zip(types, mapped, strict=True))}
    outputs = {f"y{i}": wp.array[t] for i, t in enumerate(results)}
    arguments = ", ".join(f"{name}[i]" if m else name for name, m in zip(inputs, mapped, strict=True))
    values = ", ".join(f"value{i}" for i in range(len(outputs)))
    stores = [f"    {name}[i] = value{i}" for i, name in enumerate(outputs)]
    head = f"def jvp_kernel({', '.join([*inputs, *outputs])}):"
    source = "\n".join([head, "    i = wp.tid()", f"    {values} = function({arguments})", *stores, ""])
    kernel = define(source, "jvp_kernel", {"wp": wp, "function": function, "__name__": __name__}, inputs | outputs)
    return wp.kernel(kernel, module="unique", enable_backward=False), results
