"""The kernel of a training step on the CPU: one thread takes the whole batch, a chunk of samples at a time."""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.kept import kept_by
from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.cpu import backward as cpu_backward
from warp_neural.kernels.training.cpu import forward as cpu
from warp_neural.kernels.training.progress import Progress, batch_of
from warp_neural.kernels.training.taped import data_type, make_all_finite, make_draw


@cache
def make_access(spec: NetworkSpec, vec_in: type):
    """Access to vectors of sample i of a chunk: write_input, read_result, write_gradient, read_input_gradient."""
    vec_gradient, vec_out = (wp.types.vector(n, wp.float32) for n in (spec.sizes[0], spec.sizes[-1]))

    @wp.func_native(cpu.write_input_text(spec))
    def write_input(scratch: wp.array[float], i: int, x: vec_in): ...

    @wp.func_native(cpu.read_result_text(spec))
    def read_result(scratch: wp.array[float], i: int) -> vec_out: ...

    @wp.func_native(cpu.write_gradient_text(spec))
    def write_gradient(scratch: wp.array[float], i: int, dy: vec_out): ...

    @wp.func_native(cpu.read_input_gradient_text(spec))
    def read_input_gradient(scratch: wp.array[float], i: int) -> vec_gradient: ...

    return write_input, read_result, write_gradient, read_input_gradient


@cache
def make_passes(spec: NetworkSpec, input_gradient: bool):
    """What a chunk goes through: begin and finish once a batch, forward and backward for `count` samples."""

    @wp.func_native(cpu.begin_text(spec))
    def begin(params: Parameters, scratch: wp.array[float]): ...

    @wp.func_native(cpu.chunk_forward_text(spec))
    def forward(params: Parameters, scratch: wp.array[float], count: int): ...

    @wp.func_native(cpu_backward.chunk_backward_text(spec, input_gradient))
    def backward(scratch: wp.array[float], count: int): ...

    @wp.func_native(cpu_backward.add_gradient_text(spec))
    def finish(scratch: wp.array[float], gradient: wp.array[float]) -> bool: ...

    return begin, forward, backward, finish


@kept_by("sample")
def make_cpu_gradient_kernel(
    spec: NetworkSpec, sample: wp.Function, loss: Loss, encode=None, encode_adjoint=None, from_encoded: bool = False
):
    """dim 1, on the CPU. sample: `(index, random state, data) -> (x, target)`, or without data.

    Arguments: params; data; progress; micro, which of the `batches` of a step; scratch [cpu.areas(spec)]; xs, targets
    [cpu.CHUNK]; gradient, of all parameters, to which is added: multiplied by `progress.scale`, not divided by the
    batch. The adjoint of the encoding adds to `params.master.grad`, the same array. from_encoded: the network's input
    is row i of `encoded`, which then holds its gradient.
    """
    n_out, data, draw = spec.sizes[-1], data_type(sample), make_draw(sample)
    vec_in = encode.input_types["x"] if encode else spec.vec_in
    vec_first = wp.types.vector(spec.sizes[0], wp.float32) if encode or from_encoded else spec.vec_in
    vec_out, value, gradient_of = wp.types.vector(n_out, wp.float32), loss.value(n_out), loss.gradient(n_out)
    trains_encoding, chunk = encode_adjoint is not None, wp.constant(cpu.CHUNK)
    write_input, read_result, write_gradient, read_input_gradient = make_access(spec, vec_first)
    begin, forward, backward, finish = make_passes(spec, trains_encoding or from_encoded)
    all_finite = make_all_finite(spec.sizes[0])
    load, store = make_load(spec.sizes[0], wp.float32), make_store(spec.sizes[0], wp.float32)

    @wp.kernel(module="unique", enable_backward=False)
    def gradient_kernel(
        params: Parameters,
        data: data,
        progress: Progress,
        micro: int,
        batches: int,
        scratch: wp.array[float],
        xs: wp.array[vec_in],
        targets: wp.array[vec_out],
        gradient: wp.array[float],
        encoded: wp.array2d[float],
    ):
        step = progress.counters[0]
        progress.counters[1] = step
        batch = batch_of(progress, step)
        scale = progress.scale[step % 2]
        total, encoding_finite = wp.float64(0.0), bool(True)
        begin(params, scratch)
        for start in range(0, batch, chunk):
            count = wp.min(batch - start, chunk)
            for i in range(count):
                x, target = draw(progress, step, micro * batch + start + i, data)
                xs[i] = x
                targets[i] = target
                if wp.static(from_encoded):
                    write_input(scratch, i, load(encoded, start + i))
                elif wp.static(encode is not None):
                    write_input(scratch, i, encode(params, x))
                else:
                    write_input(scratch, i, x)
            forward(params, scratch, count)
            for i in range(count):
                y = read_result(scratch, i)
                total += wp.float64(value(y, targets[i]))
                write_gradient(scratch, i, gradient_of(y, targets[i]) * scale)
            backward(scratch, count)
            if wp.static(trains_encoding):
                for i in range(count):
                    dx = read_input_gradient(scratch, i)
                    encoding_finite = encoding_finite and all_finite(dx)
                    encode_adjoint(params, xs[i], dx)
            if wp.static(from_encoded):
                for i in range(count):
                    store(encoded, start + i, read_input_gradient(scratch, i))
        finite = finish(scratch, gradient)
        if not finite or not encoding_finite or not wp.isfinite(total):
            progress.flags[step % 2] = 1
        slot = step % progress.losses.shape[0]
        if micro == 0:
            progress.losses[slot] = 0.0
        progress.losses[slot] += float(total / wp.float64(batch * batches))

    return gradient_kernel
