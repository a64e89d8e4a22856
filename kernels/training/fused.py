"""The fused kernel of a training step on CUDA: samples, forward, loss, backward and the sums of gradients."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.encoded_batch import encoded_type
from warp_neural.kernels.training.hopper64 import backward as hopper64_backward
from warp_neural.kernels.training.hopper64 import forward as hopper64
from warp_neural.kernels.training.hopper64.schedule import Hopper64Schedule
from warp_neural.kernels.training.hopper128 import backward as hopper128_backward
from warp_neural.kernels.training.hopper128 import forward as hopper128
from warp_neural.kernels.training.hopper128.schedule import Hopper128Schedule
from warp_neural.kernels.training.mma import backward as mma_backward
from warp_neural.kernels.training.mma import forward as mma
from warp_neural.kernels.training.mma.finish import finish_text
from warp_neural.kernels.training.mma.schedule import MmaSchedule
from warp_neural.kernels.training.progress import Progress, batch_of
from warp_neural.kernels.training.taped import data_type, make_draw

FusedSchedule = MmaSchedule | Hopper64Schedule | Hopper128Schedule


class Texts(NamedTuple):
    """The native functions that a fused kernel is made of, or their texts; see the rooms."""

    begin: Any
    forward: Any
    upper_layers: Any
    begin_first_layer: Any
    first_layer: Any
    input_gradient: Any
    finish: Any


def cuda_only(text: str, otherwise: str = "") -> str:
    return f"#if defined(__CUDA_ARCH__)\n{text}\n#else\n{otherwise}\n#endif\n"


def make_texts(spec: NetworkSpec, schedule: FusedSchedule, x_type: type, input_gradient: bool) -> Texts:
    if isinstance(schedule, MmaSchedule):
        return Texts(
            mma.begin_text(spec, schedule),
            mma.forward_text(spec, schedule),
            mma_backward.upper_layers_text(spec, schedule),
            "return sums;",
            mma_backward.first_layer_text(spec, schedule, input_gradient),
            mma_backward.input_gradient_text(spec, schedule, x_type),
            finish_text(schedule),
        )
    on_128 = isinstance(schedule, Hopper128Schedule)
    forward, backward = (hopper128, hopper128_backward) if on_128 else (hopper64, hopper64_backward)
    return Texts(
        hopper64.begin_text(spec, schedule),
        forward.forward_text(spec, schedule, x_type is wp.float16),
        backward.upper_layers_text(spec, schedule),
        backward.begin_first_layer_text(spec, schedule),
        backward.first_layer_text(spec, schedule, input_gradient),
        hopper64_backward.input_gradient_text(spec, schedule, forward.enter(spec, schedule), x_type),
        backward.finish_text(schedule),
    )


@cache
def make_functions(spec: NetworkSpec, schedule: FusedSchedule, x_type: type, input_gradient: bool) -> Texts:
    """x_type: of the elements of the network's inputs and their gradients."""
    vec_in, vec_out = wp.types.vector(spec.sizes[0], x_type), wp.types.vector(spec.sizes[-1], wp.float32)
    shared, sums = wp.tile(dtype=wp.uint32, shape=(schedule.words,)), wp.types.vector(schedule.sums, wp.float32)

    texts = make_texts(spec, schedule, x_type, input_gradient)

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
def make_input(encode: wp.Function | None, vec_in: type, from_encoded: bool) -> wp.Function:
    """`(params, x, encoded, i) -> the network's input`: x, encoded if it is to be, or row i."""
    load = make_load(vec_in._length_, vec_in._wp_scalar_type_)

    @wp.func
    def input(params: Parameters, x: Any, encoded: wp.array2d(dtype=Any), i: int):
        if wp.static(from_encoded):
            return load(encoded, i)
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


def samples_of(schedule: FusedSchedule) -> int:
    """Of a block in a round."""
    return schedule.threads // 32 * schedule.lanes


@cache
def make_gradient_kernel(
    spec: NetworkSpec, schedule: FusedSchedule, sample: wp.Function, loss: Loss, encode=None, from_encoded: bool = False
) -> wp.Kernel:
    """The fused kernel for CUDA: dim blocks * schedule.threads, block_dim schedule.threads.

    sample: `(index, random state, data) -> (x, target)`, or without data. Arguments: params; data; progress; micro,
    which of the batches of a step (from 1 on, gradients add to what is there); partial [blocks, schedule.block_sums],
    every block's sums. Gradients are not yet divided by the batch, and multiplied by `progress.scale`.

    encode: an encoding without parameters. from_encoded: x is row i of `encoded`, which then holds its gradient.
    kept: what `make_lower_kernel` needs (`kept_units`).
    """
    draw, data, encoded_of = make_draw(sample), data_type(sample), encoded_type(spec.format)
    vec_in = wp.types.vector(spec.sizes[0], encoded_of if from_encoded else wp.float32 if encode else spec.dtype)
    writes_encoded, lanes = from_encoded and schedule.reaches_input, schedule.lanes
    functions = make_functions(spec, schedule, vec_in._wp_scalar_type_, writes_encoded)
    sums_type = wp.types.vector(schedule.sums, wp.float32)
    begin, forward, upper_layers, begin_first_layer, first_layer, input_gradient, finish = functions
    input, results = make_input(encode, vec_in, from_encoded), make_results(spec, loss)
    words, per_round, store = schedule.words, samples_of(schedule), make_store(spec.sizes[0], encoded_of)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=schedule.threads)
    def gradient_kernel(
        params: Parameters,
        data: data,
        progress: Progress,
        micro: int,
        partial: wp.array2d[float],
        encoded: wp.array2d[encoded_of],
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
            z = forward(params, memory, input(params, x, encoded, wp.min(i, batch - 1)), kept, start)
            value, dy = results(z, target, inside, scale)
            total += value
            sums = upper_layers(memory, sums, z, dy, kept, start)
            sums = begin_first_layer(memory, sums)
            # the next sample, early: reading it may take as long as the first layer
            next_x, next_target = draw(progress, step, micro * batch + wp.min(i + stride, batch - 1), data)
            sums = first_layer(memory, sums)
            if wp.static(writes_encoded):
                dx = input_gradient(memory)  # whole warps
                if inside:
                    store(encoded, i, dx)
            x = next_x
            target = next_target
        if thread == 0:
            progress.counters[1] = step
        finish(memory, sums, total, partial, progress.flags, parity, micro > 0)

    return gradient_kernel
