"""The kernel of the lower pass of a fused training step on CUDA: see `Schedule.lower`."""

import warp as wp

from warp_neural.kernels.coopvec.memory import make_store
from warp_neural.kernels.kept import kept_by
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.encoded_batch import encoded_type
from warp_neural.kernels.training.functions import make_lower_functions
from warp_neural.kernels.training.progress import Progress, batch_of
from warp_neural.kernels.training.schedule import Schedule
from warp_neural.kernels.training.taped import data_type


@kept_by("sample")
def make_lower_kernel(spec: NetworkSpec, schedule: Schedule, sample: wp.Function, from_encoded: bool) -> wp.Kernel:
    """After `fused.make_gradient_kernel`, with the same dims and arguments; data are not read."""
    lower, encoded_of, data = schedule.lower, encoded_type(spec.format), data_type(sample)
    sums_type, store = wp.types.vector(lower.sums, wp.float32), make_store(spec.sizes[0], encoded_of)
    begin, fetch, layers, input_gradient, finish = make_lower_functions(spec, schedule, encoded_of, from_encoded)
    words, lanes, per_round = lower.words, lower.lanes, lower.round_samples

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=lower.threads)
    def lower_kernel(
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
        memory = wp.tile_empty(shape=words, dtype=wp.uint32, storage="shared")
        sums = sums_type()
        stride = partial.shape[0] * per_round
        lane = thread % 32
        first = thread / 32 * wp.static(lanes) + lane
        fetch(memory, kept)
        begin(params, memory)
        for start in range(0, batch, stride):
            later = start + stride
            sums = layers(memory, sums, kept, later, later < batch)
            if wp.static(from_encoded):
                dx = input_gradient(memory)  # whole warps
                if lane < wp.static(lanes) and start + first < batch:
                    store(encoded, start + first, dx)
        finish(memory, sums, 0.0, partial, progress.flags, step % 2, micro > 0)

    return lower_kernel
