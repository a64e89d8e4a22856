"""The native functions that the kernels of a fused training step on CUDA are made of."""

from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.native import unroll
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.rooms import room_of
from warp_neural.kernels.training.schedule import LowerTexts, Schedule, Texts


def cuda_only(text: str, otherwise: str = "") -> str:
    return f"#if defined(__CUDA_ARCH__)\n{unroll(text)}\n#else\n{otherwise}\n#endif\n"


@cache
def make_functions(spec: NetworkSpec, schedule: Schedule, x_type: type, input_gradient: bool) -> Texts:
    """Of a fused kernel: see `Room` for the arguments."""
    vec_in, vec_out = wp.types.vector(spec.sizes[0], x_type), wp.types.vector(spec.sizes[-1], wp.float32)
    shared, sums = wp.tile(dtype=wp.uint32, shape=(schedule.words,)), wp.types.vector(schedule.sums, wp.float32)

    texts = room_of(schedule).make_texts(spec, schedule, x_type, input_gradient)

    @wp.func_native(cuda_only(texts.begin))
    def begin(params: Parameters, memory: shared): ...

    @wp.func_native(cuda_only(texts.forward, "return {};"))
    def forward(params: Parameters, memory: shared, x: vec_in, kept: wp.array[wp.vec4ui], start: int) -> vec_out: ...

    @wp.func_native(cuda_only(texts.upper_layers, "return sums;"))
    def upper_layers(
        memory: shared, sums: sums, z: vec_out, dy: vec_out, kept: wp.array[wp.vec4ui], start: int
    ) -> sums: ...

    @wp.func_native(cuda_only(texts.begin_first_layer, "return sums;"))
    def begin_first_layer(memory: shared, sums: sums) -> sums: ...

    @wp.func_native(cuda_only(texts.first_layer, "return sums;"))
    def first_layer(memory: shared, sums: sums) -> sums: ...

    @wp.func_native(cuda_only(texts.input_gradient, "return {};"))
    def dx(memory: shared) -> vec_in: ...

    finish = make_finish(texts.finish, shared, sums)
    return Texts(begin, forward, upper_layers, begin_first_layer, first_layer, dx, finish)


@cache
def make_lower_functions(spec: NetworkSpec, schedule: Schedule, x_type: type, input_gradient: bool) -> LowerTexts:
    """The same of its lower pass."""
    lower = schedule.lower
    vec_in, sums = wp.types.vector(spec.sizes[0], x_type), wp.types.vector(lower.sums, wp.float32)
    shared = wp.tile(dtype=wp.uint32, shape=(lower.words,))
    texts = room_of(schedule).make_lower_texts(spec, lower, x_type, input_gradient)

    @wp.func_native(cuda_only(texts.begin))
    def begin(params: Parameters, memory: shared): ...

    @wp.func_native(cuda_only(texts.fetch))
    def fetch(memory: shared, kept: wp.array[wp.vec4ui]): ...

    @wp.func_native(cuda_only(texts.layers, "return sums;"))
    def layers(memory: shared, sums: sums, kept: wp.array[wp.vec4ui], next: int, inside: bool) -> sums: ...

    @wp.func_native(cuda_only(texts.input_gradient, "return {};"))
    def dx(memory: shared) -> vec_in: ...

    return LowerTexts(begin, fetch, layers, dx, make_finish(texts.finish, shared, sums))


def make_finish(text: str, shared: Any, sums: type) -> wp.Function:
    """What a block leaves in its row of `partial`; a flag if it is not finite. shared, sums: types of its memory."""

    @wp.func_native(cuda_only(text))
    def finish(
        memory: shared,
        sums: sums,
        loss: float,
        partial: wp.array2d[float],
        flags: wp.array[int],
        parity: int,
        add: bool,
    ): ...

    return finish
