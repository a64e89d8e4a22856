"""The kernels of a fused training step, one factory per kernel, and what they share on the device."""

from functools import cache

import warp as wp

from kernels.coopvec.memory import make_load, make_store
from kernels.coopvec.spec import NetworkSpec, Parameters
from kernels.losses import Loss
from kernels.training import cuda, cuda_backward, cuda_finish
from kernels.training.encoded import row_type
from kernels.training.general import data_type, make_draw
from kernels.training.plan import make_plan
from kernels.training.progress import Progress, batch_of


def cuda_only(text: str, otherwise: str) -> str:
    return f"#if defined(__CUDA_ARCH__)\n{text}\n#else\n{otherwise}\n#endif\n"


@cache
def make_gradient_kernel(spec: NetworkSpec, sample: wp.Function, loss: Loss, encode=None, by_rows: bool = False):
    """The fused kernel for CUDA: dim blocks * plan.threads, block_dim plan.threads.

    sample: `(index, random state, data) -> (x, target)`, or without data. Arguments: params; data; progress; micro,
    which of the batches of a step (from 1 on, gradients add to what is there); partial [blocks, plan.slice],
    every block's sums. Gradients are not yet divided by the batch, and multiplied by `progress.scale`.

    encode: an encoding without parameters. by_rows: x is row i of `rows` instead, which then holds its gradient.
    """
    plan = make_plan(spec)
    n_out, words = spec.sizes[-1], plan.words
    rows_of, n_in = row_type(spec.format), spec.sizes[0]
    vec_in = wp.types.vector(n_in, rows_of if by_rows else wp.float32 if encode else spec.dtype)
    load, store = make_load(n_in, rows_of), make_store(n_in, rows_of)
    vec_out, sums_type = wp.types.vector(n_out, wp.float32), wp.types.vector(plan.sums, wp.float32)
    shared = wp.tile(dtype=wp.uint32, shape=(words,))
    activate, value, gradient = spec.output_activation.func, loss.value(n_out), loss.gradient(n_out)
    draw, data = make_draw(sample), data_type(sample)
    per_round = plan.threads

    @wp.func_native(cuda_only(cuda.begin(spec, plan), ""))
    def begin(params: Parameters, memory: shared): ...

    @wp.func_native(cuda_only(cuda.forward(spec, plan), "return {};"))
    def forward(params: Parameters, memory: shared, x: vec_in) -> vec_out: ...

    @wp.func_native(cuda_only(cuda_backward.upper_layers(spec, plan), "return sums;"))
    def upper_layers(memory: shared, sums: sums_type, z: vec_out, dy: vec_out) -> sums_type: ...

    @wp.func_native(cuda_only(cuda_backward.first_layer(spec, plan, by_rows), "return sums;"))
    def first_layer(memory: shared, sums: sums_type) -> sums_type: ...

    @wp.func_native(cuda_only(cuda_backward.input_gradient(spec, plan, rows_of), "return {};"))
    def input_gradient(memory: shared) -> vec_in: ...

    @wp.func_native(cuda_only(cuda_finish.finish(plan), ""))
    def finish(
        memory: shared,
        sums: sums_type,
        loss: float,
        partial: wp.array2d[float],
        flags: wp.array[int],
        parity: int,
        add: bool,
    ): ...

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=(plan.threads, plan.blocks))
    def gradient_kernel(
        params: Parameters,
        data: data,
        progress: Progress,
        micro: int,
        partial: wp.array2d[float],
        rows: wp.array2d[rows_of],
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
        x, target = draw(progress, step, micro * batch + wp.min(thread, batch - 1), data)
        begin(params, memory)
        for start in range(0, batch, stride):
            i = start + thread
            inside = i < batch
            if wp.static(by_rows):
                z = forward(params, memory, load(rows, wp.min(i, batch - 1)))
            elif wp.static(encode is not None):
                z = forward(params, memory, encode(params, x))
            else:
                z = forward(params, memory, x)
            y = vec_out()
            for j in range(wp.static(n_out)):
                y[j] = activate(z[j])
            dy = vec_out()
            if inside:
                total += value(y, target)
                dy = gradient(y, target) * scale
            sums = upper_layers(memory, sums, z, dy)
            # the next sample, early: reading it may take as long as the first layer
            next_x, next_target = draw(progress, step, micro * batch + wp.min(i + stride, batch - 1), data)
            sums = first_layer(memory, sums)
            if wp.static(by_rows):
                if inside:
                    store(rows, i, input_gradient(memory))
            x = next_x
            target = next_target
        if thread == 0:
            progress.counters[1] = step
        finish(memory, sums, total, partial, progress.flags, parity, micro > 0)

    return gradient_kernel
