"""Loops that carry a state, with a right gradient.

Warp 1.19 keeps no state of a loop's trips: its backward pass differentiates each trip where the last one ended. Here
each trip gets its own state back. Warp runs forward code again before its adjoint, "replays" it, and lets a function
be replayed by another: `trip`, the identity forwards, computes the state of its trip when it is replayed, from
checkpoints (Griewank and Walther, Evaluating Derivatives, 2008, chapter 12; here on two levels).
"""

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any

import warp as wp

from warp_neural.autodiff.source import execute
from warp_neural.errors import InputError
from warp_neural.kernels.autodiff.checkpoints import make_address_of, stride_of

# `data` stands for the parameters of the body between state and trip; without a condition its lines go.
TEXT = """
def advance(state, data, first, last):
    for i in range(first, last):
        state = body(state, data, i)
    return state

def record(memory, offset, state, data, first, last):
    trips, stride = int(0), int(1)
    for i in range(first, last):
        if not condition(state, data, i): break
        if trips == stride * count:  # the memory is full: drop every second state
            for k in range(half):
                memory[offset + k] = memory[offset + 2 * k]
            stride *= 2
        if trips % stride == 0:
            memory[offset + trips / stride] = state
        state = body(state, data, i)
        trips += 1
    return trips

def begin(memory, state, data, n):
    return n

def replay_begin(memory, state, data, n):  # all states that have room, and how many trips the forward pass took
    return record(memory, 0, state, data, 0, n)

def trip(memory, state, data, i, trips):
    return state

def replay_trip(memory, state, data, i, trips):  # the state before trip i; they come last first
    stride = stride_of(trips, count)
    first = i - i % stride
    last = wp.min(first + stride, trips)
    if i == last - 1:
        record(memory, count, memory[first / stride], data, first, last)
    inner = stride_of(last - first, count)
    nearest = (i - first) / inner
    return advance(memory[count + nearest], data, first + nearest * inner, i)

def loop(state, data, n):
    storage = Storage()
    memory = wp.array(ptr=address_of(storage), shape=(places,), dtype=State)
    trips = begin(memory, state, data, n)
    for i in range(trips):
        here = trip(memory, state, data, i, trips)
        if not condition(here, data, i): break
        state = body(here, data, i)
    return state
"""


def loop(body: wp.Function, condition: wp.Function | None = None, *, checkpoints: int = 16) -> wp.Function:
    """A `@wp.func` that repeats `body`, with the gradient that a loop in a kernel does not have.

        @wp.func
        def body(h: vec, params: net.Params, x: wp.array2d[float], i: int) -> vec: ...  # the state after trip i

        recur = wn.autodiff.loop(body)  # outside of the kernel
        h = recur(h, params, x, n)      # inside: `for i in range(n): h = body(h, params, x, i)`

    `body` takes a state, any number of further arguments, and the number of the trip; it returns the next state. The
    state is a float, vector, matrix, quaternion or `@wp.struct`, no array. Gradients reach the first state and the
    further arguments: floats, vectors, structs, arrays (their `.grad`), parameters of networks. `n` may differ between
    threads, and be any number. With a `condition`, of the same arguments as `body`, to bool, the loop ends before the
    first trip where it is false; the derivative takes the number of trips for constant.

    The backward pass runs `body` forwards again, so it must not write to memory: up to checkpoints^2 trips three
    times each, beyond them trips / checkpoints^2 / 2 times more. A thread keeps 2 * `checkpoints` states for it (an
    even number; in local memory on CUDA). The forward pass costs what a plain loop does.

    Sphere tracing, where `step` adds the distance at the ray's end, and absorption along it:

        @wp.func
        def step(t: float, ray: Ray, params: net.Params, i: int) -> float:
            return t + net.func(params, ray.origin + t * ray.direction)[0]

        @wp.func
        def outside(t: float, ray: Ray, params: net.Params, i: int) -> bool:
            return net.func(params, ray.origin + t * ray.direction)[0] > 1.0e-3

        @wp.func
        def absorb(light: wp.vec3, ray: Ray, fog: wp.array[float], i: int) -> wp.vec3:
            return light * wp.exp(-fog[i] * ray.spacing)

        trace, transmit = wn.autodiff.loop(step, outside), wn.autodiff.loop(absorb)
        t = trace(0.0, ray, params, 64)
        light = transmit(wp.vec3(1.0), ray, fog, fog.shape[0])
    """
    if checkpoints < 2 or checkpoints % 2:
        raise InputError(f"checkpoints={checkpoints}: an even number of at least 2")
    return _make_loop(body, condition, checkpoints)


@cache
def _make_loop(body: wp.Function, condition: wp.Function | None, count: int) -> wp.Function:
    types = _arguments(body)
    counts = len(types) > 1 and _same(types[-1:], [int])
    if not counts or wp.types.is_array(types[0]) or not _returns(body, types[0]):
        raise InputError(f"loop of {body.key}: expected a function (state, ..., int) -> state, the state no array")
    if condition is not None and not (_same(_arguments(condition), types) and _returns(condition, wp.bool)):
        raise InputError(f"loop of {body.key}: expected of {condition.key} the same arguments, and a bool")
    state, *data, _trip = types
    data = {f"data_{i}": type_ for i, type_ in enumerate(data)}
    source = TEXT.replace(", data", "".join(f", {name}" for name in data))
    if condition is None:
        source = "\n".join(line for line in source.split("\n") if "condition(" not in line)
    namespace = {"wp": wp, "body": body, "condition": condition, "stride_of": stride_of, "__name__": __name__}
    words = 2 * count * -(-wp.types.type_size_in_bytes(state) // 8)
    storage = wp.types.vector(words, wp.uint64)
    namespace |= {"State": state, "Storage": storage, "address_of": make_address_of(storage)}
    namespace |= {"count": count, "half": count // 2, "places": 2 * count}
    execute(source, namespace)
    known = {"memory": wp.array[state], "state": state, **data}
    for name in ("advance", "record", "begin", "trip", "loop"):
        function = wp.func(_annotate(namespace[name], known), name=f"{body.key}_{name}", module="unique")
        if f"replay_{name}" in namespace:
            wp.func_replay(function)(_annotate(namespace[f"replay_{name}"], known))
        namespace[name] = function
    return namespace["loop"]


def _annotate(function: Callable, known: dict[str, Any]) -> Callable:
    """With the types of its arguments; those that are not known are integers."""
    function.__annotations__ = {name: known.get(name, int) for name in inspect.signature(function).parameters}
    return function


def _arguments(func: wp.Function) -> list[Any]:
    return list(func.input_types.values())


def _same(a: list[Any], b: list[Any]) -> bool:
    return len(a) == len(b) and all(map(wp.types.types_equal, a, b))


def _returns(func: wp.Function, type_: Any) -> bool:
    """Whether a function returns one value, of this type."""
    if func.user_templates or len(func.user_overloads) != 1:
        raise InputError(f"loop of {func.key}: generic or overloaded; expected one function with types")
    if func.value_func is None:
        func.build(None)
    results = func.value_func(func.input_types, None)
    return _same(list(results) if isinstance(results, (list, tuple)) else [results], [type_])
