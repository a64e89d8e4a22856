"""The kernel of the lower pass of a fused training step for 128 neurons a layer (see `hopper128.schedule`)."""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.memory import make_store
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.encoded_batch import encoded_type
from warp_neural.kernels.training.fused import cuda_only, make_finish, samples_of
from warp_neural.kernels.training.hopper64.backward import input_gradient_text
from warp_neural.kernels.training.hopper64.forward import begin_text
from warp_neural.kernels.training.hopper128.backward import finish_text
from warp_neural.kernels.training.hopper128.forward import enter
from warp_neural.kernels.training.hopper128.lower import first_fetch_text, lower_layers_text
from warp_neural.kernels.training.hopper128.schedule import SAMPLES, SLOT, Hopper128LowerSchedule
from warp_neural.kernels.training.progress import Progress, batch_of


def kept_units(schedule: Hopper128LowerSchedule, blocks: int, batch: int) -> int:
    """Memory between the passes, for the samples of whole rounds, in 16 bytes."""
    round = blocks * samples_of(schedule)
    return -(-batch // round) * round // SAMPLES * schedule.kept * SLOT // 16


@cache
def make_lower_kernel(spec: NetworkSpec, schedule: Hopper128LowerSchedule, from_encoded: bool) -> wp.Kernel:
    """After `make_gradient_kernel`, with the same dims and arguments, but for the data of samples."""
    encoded_of = encoded_type(spec.format)
    vec_in, sums_type = wp.types.vector(spec.sizes[0], encoded_of), wp.types.vector(schedule.sums, wp.float32)
    shared, lanes, per_round = wp.tile(dtype=wp.uint32, shape=(schedule.words,)), schedule.lanes, samples_of(schedule)
    words, store = schedule.words, make_store(spec.sizes[0], encoded_of)

    @wp.func_native(cuda_only(begin_text(spec, schedule)))
    def begin(params: Parameters, memory: shared): ...

    @wp.func_native(cuda_only(first_fetch_text(spec, schedule)))
    def fetch(memory: shared, kept: wp.array[wp.vec4ui]): ...

    @wp.func_native(cuda_only(lower_layers_text(spec, schedule, from_encoded), "return sums;"))
    def layers(memory: shared, sums: sums_type, kept: wp.array[wp.vec4ui], next: int, inside: bool) -> sums_type: ...

    dx_text = input_gradient_text(spec, schedule, enter(spec, schedule), encoded_of)

    @wp.func_native(cuda_only(dx_text, "return {};"))
    def input_gradient(memory: shared) -> vec_in: ...

    finish = make_finish(finish_text(schedule), shared, sums_type)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=schedule.threads)
    def lower_kernel(
        params: Parameters,
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
