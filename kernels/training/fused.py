"""The kernels of a fused training step on CUDA: samples, forward, loss, backward and the sums of gradients."""

from functools import cache
from typing import Any

import warp as wp

from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.kept import kept_by
from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.encoded_batch import encoded_type
from warp_neural.kernels.training.functions import make_functions
from warp_neural.kernels.training.lower import make_lower_kernel
from warp_neural.kernels.training.progress import Progress, batch_of
from warp_neural.kernels.training.schedule import Schedule
from warp_neural.kernels.training.taped import data_type, make_draw


def make_kernels(
    spec: NetworkSpec,
    schedule: Schedule,
    sample: wp.Function,
    loss: Loss,
    encode=None,
    from_encoded: bool = False,
    fast_math: bool = False,
) -> list[wp.Kernel]:
    """One for each pass, with the dims and arguments of `make_gradient_kernel`."""
    kernels = [make_gradient_kernel(spec, schedule, sample, loss, encode, from_encoded, fast_math)]
    if schedule.lower:
        kernels.append(make_lower_kernel(spec, schedule, sample, from_encoded))
    return kernels


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


@kept_by("sample")
def make_gradient_kernel(
    spec: NetworkSpec,
    schedule: Schedule,
    sample: wp.Function,
    loss: Loss,
    encode=None,
    from_encoded: bool = False,
    fast_math: bool = False,
) -> wp.Kernel:
    """The fused kernel for CUDA: dim blocks * schedule.threads, block_dim schedule.threads.

    sample: `(index, random state, data) -> (x, target)`, or without data. Arguments: params; data; progress; micro,
    which of the batches of a step (from 1 on, gradients add to what is there); partial [blocks, schedule.block_sums],
    every block's sums. Gradients are not yet divided by the batch, and multiplied by `progress.scale`.

    encode: an encoding without parameters. from_encoded: x is row i of `encoded`, which then holds its gradient.
    fast_math: exponentials and quotients of a few operations, with errors of a few units in the last place.
    kept: what a lower pass needs [schedule.kept_units].
    """
    draw, data, encoded_of = make_draw(sample), data_type(sample), encoded_type(spec.format)
    vec_in = wp.types.vector(spec.sizes[0], encoded_of if from_encoded else wp.float32 if encode else spec.dtype)
    writes_encoded, lanes = from_encoded and schedule.reaches_input, schedule.lanes
    functions = make_functions(spec, schedule, vec_in._wp_scalar_type_, writes_encoded)
    sums_type = wp.types.vector(schedule.sums, wp.float32)
    begin, forward, upper_layers, begin_first_layer, first_layer, input_gradient, finish = functions
    input, results = make_input(encode, vec_in, from_encoded), make_results(spec, loss)
    words, per_round, store = schedule.words, schedule.round_samples, make_store(spec.sizes[0], encoded_of)

    options = {"fast_math": fast_math}

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=schedule.threads, module_options=options)
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
