"""The fused kernel of a training step on CUDA: samples, forward, loss, backward and the sums of gradients."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.encoded_batch import row_type
from warp_neural.kernels.training.hopper64 import backward as warpgroup_backward
from warp_neural.kernels.training.hopper64 import forward as warpgroup
from warp_neural.kernels.training.hopper64.schedule import WarpgroupPlan
from warp_neural.kernels.training.hopper128 import backward as wide_backward
from warp_neural.kernels.training.hopper128 import forward as wide
from warp_neural.kernels.training.hopper128.schedule import UpperPlan
from warp_neural.kernels.training.mma import backward as cuda_backward
from warp_neural.kernels.training.mma import finish as cuda_finish
from warp_neural.kernels.training.mma import forward as cuda
from warp_neural.kernels.training.mma.schedule import Plan
from warp_neural.kernels.training.progress import Progress, batch_of
from warp_neural.kernels.training.taped import data_type, make_draw

FusedPlan = Plan | WarpgroupPlan | UpperPlan


class Parts(NamedTuple):
    """The native functions that a fused kernel is made of, or their texts; see `cuda`, `cuda_backward`, and so on."""

    begin: Any
    forward: Any
    upper_layers: Any
    begin_first_layer: Any
    first_layer: Any
    input_gradient: Any
    finish: Any


def cuda_only(text: str, otherwise: str = "") -> str:
    return f"#if defined(__CUDA_ARCH__)\n{text}\n#else\n{otherwise}\n#endif\n"


def make_texts(spec: NetworkSpec, plan: FusedPlan, x_type: type, input_gradient: bool) -> Parts:
    if isinstance(plan, Plan):
        return Parts(
            cuda.begin(spec, plan),
            cuda.forward(spec, plan),
            cuda_backward.upper_layers(spec, plan),
            "return sums;",
            cuda_backward.first_layer(spec, plan, input_gradient),
            cuda_backward.input_gradient(spec, plan, x_type),
            cuda_finish.finish(plan),
        )
    forward, backward = (wide, wide_backward) if isinstance(plan, UpperPlan) else (warpgroup, warpgroup_backward)
    return Parts(
        warpgroup.begin(spec, plan),
        forward.forward(spec, plan, x_type is wp.float16),
        backward.upper_layers(spec, plan),
        backward.begin_first_layer(spec, plan),
        backward.first_layer(spec, plan, input_gradient),
        warpgroup_backward.input_gradient(spec, plan, forward.enter(spec, plan), x_type),
        backward.finish(plan),
    )


@cache
def make_parts(spec: NetworkSpec, plan: FusedPlan, x_type: type, input_gradient: bool) -> Parts:
    """x_type: of the elements of the network's inputs and their gradients."""
    vec_in, vec_out = wp.types.vector(spec.sizes[0], x_type), wp.types.vector(spec.sizes[-1], wp.float32)
    shared, sums = wp.tile(dtype=wp.uint32, shape=(plan.words,)), wp.types.vector(plan.sums, wp.float32)

    texts = make_texts(spec, plan, x_type, input_gradient)

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
    return Parts(begin, forward, upper_layers, begin_first_layer, first_layer, dx, finish)


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


@cache
def make_input(encode: wp.Function | None, vec_in: type, by_rows: bool) -> wp.Function:
    """`(params, x, rows, i) -> the network's input`: x, encoded if it is to be, or row i."""
    load = make_load(vec_in._length_, vec_in._wp_scalar_type_)

    @wp.func
    def input(params: Parameters, x: Any, rows: wp.array2d(dtype=Any), i: int):
        if wp.static(by_rows):
            return load(rows, i)
        elif wp.static(encode is not None):
            return encode(params, x)
        else:
            return x

    return input


@cache
def make_results(spec: NetworkSpec, loss: Loss) -> wp.Function:
    """`(z, target, inside, scale) -> (loss, its scaled gradient)` of one sample; zeros unless `inside`."""
    n_out = spec.sizes[-1]
    vec_out, activate = wp.types.vector(n_out, wp.float32), spec.output_activation.func
    value, gradient = loss.value(n_out), loss.gradient(n_out)

    @wp.func
    def results(z: vec_out, target: vec_out, inside: bool, scale: float):
        total = float(0.0)
        dy = vec_out()
        if inside:
            y = vec_out()
            for j in range(wp.static(n_out)):
                y[j] = activate(z[j])
            total = value(y, target)
            dy = gradient(y, target) * scale
        return total, dy

    return results


def samples_of(plan: FusedPlan) -> int:
    """Of a block in a round."""
    return plan.threads // 32 * plan.lanes


@cache
def make_gradient_kernel(
    spec: NetworkSpec, plan: FusedPlan, sample: wp.Function, loss: Loss, encode=None, by_rows: bool = False
) -> wp.Kernel:
    """The fused kernel for CUDA: dim blocks * plan.threads, block_dim plan.threads.

    sample: `(index, random state, data) -> (x, target)`, or without data. Arguments: params; data; progress; micro,
    which of the batches of a step (from 1 on, gradients add to what is there); partial [blocks, plan.slice], every
    block's sums. Gradients are not yet divided by the batch, and multiplied by `progress.scale`.

    encode: an encoding without parameters. by_rows: x is row i of `rows` instead, which then holds its gradient. kept:
    what `make_lower_kernel` needs (`kept_units`).
    """
    draw, data, rows_of = make_draw(sample), data_type(sample), row_type(spec.format)
    vec_in = wp.types.vector(spec.sizes[0], rows_of if by_rows else wp.float32 if encode else spec.dtype)
    writes_rows, lanes = by_rows and plan.reaches_input, plan.lanes
    parts = make_parts(spec, plan, vec_in._wp_scalar_type_, writes_rows)
    sums_type = wp.types.vector(plan.sums, wp.float32)
    begin, forward, upper_layers, begin_first_layer, first_layer, input_gradient, finish = parts
    input, results = make_input(encode, vec_in, by_rows), make_results(spec, loss)
    words, per_round, store = plan.words, samples_of(plan), make_store(spec.sizes[0], rows_of)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=plan.threads)
    def gradient_kernel(
        params: Parameters,
        data: data,
        progress: Progress,
        micro: int,
        partial: wp.array2d[float],
        rows: wp.array2d[rows_of],
        kept: wp.array[wp.vec4ui],
    ):
        thread = wp.tid()
        step = progress.counters[0]
        batch = batch_of(progress, step)
        parity = step % 2
        scale = progress.scale[parity]
        memory = wp.tile_empty(shape=words, dtype=wp.uint32, storage="shared")
        sums = sums_type()
        total = float(0.0)
        stride = partial.shape[0] * per_round
        lane = thread % 32
        first = thread / 32 * wp.static(lanes) + wp.min(lane, wp.static(lanes - 1))
        x, target = draw(progress, step, micro * batch + wp.min(first, batch - 1), data)
        begin(params, memory)
        for start in range(0, batch, stride):
            i = start + first
            inside = i < batch and lane < wp.static(lanes)
            z = forward(params, memory, input(params, x, rows, wp.min(i, batch - 1)), kept, start)
            value, dy = results(z, target, inside, scale)
            total += value
            sums = upper_layers(memory, sums, z, dy, kept, start)
            sums = begin_first_layer(memory, sums)
            # the next sample, early: reading it may take as long as the first layer
            next_x, next_target = draw(progress, step, micro * batch + wp.min(i + stride, batch - 1), data)
            sums = first_layer(memory, sums)
            if wp.static(writes_rows):
                dx = input_gradient(memory)  # whole warps
                if inside:
                    store(rows, i, dx)
            x = next_x
            target = next_target
        if thread == 0:
            progress.counters[1] = step
        finish(memory, sums, total, partial, progress.flags, parity, micro > 0)

    return gradient_kernel
