"""The kernel of the lower pass of a fused training step for 128 neurons a layer (see `wide_plan`)."""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.memory import make_store
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.encoded_batch import row_type
from warp_neural.kernels.training.fused import cuda_only, make_finish, samples_of
from warp_neural.kernels.training.hopper64 import backward as warpgroup_backward
from warp_neural.kernels.training.hopper64 import forward as warpgroup
from warp_neural.kernels.training.hopper128 import backward as wide_backward
from warp_neural.kernels.training.hopper128 import forward as wide
from warp_neural.kernels.training.hopper128 import lower as wide_lower
from warp_neural.kernels.training.hopper128.schedule import SAMPLES, SLOT, LowerPlan
from warp_neural.kernels.training.progress import Progress, batch_of


def kept_units(plan: LowerPlan, blocks: int, batch: int) -> int:
    """Memory between the passes, for the samples of whole rounds, in 16 bytes."""
    round = blocks * samples_of(plan)
    return -(-batch // round) * round // SAMPLES * plan.kept * SLOT // 16


@cache
def make_lower_kernel(spec: NetworkSpec, plan: LowerPlan, by_rows: bool) -> wp.Kernel:
    """After `make_gradient_kernel`, with the same dims and arguments, but for the data of samples."""
    rows_of = row_type(spec.format)
    vec_in, sums_type = wp.types.vector(spec.sizes[0], rows_of), wp.types.vector(plan.sums, wp.float32)
    shared, lanes, per_round = wp.tile(dtype=wp.uint32, shape=(plan.words,)), plan.lanes, samples_of(plan)
    words, store = plan.words, make_store(spec.sizes[0], rows_of)

    @wp.func_native(cuda_only(warpgroup.begin(spec, plan)))
    def begin(params: Parameters, memory: shared): ...

    @wp.func_native(cuda_only(wide_lower.begin(spec, plan)))
    def fetch(memory: shared, kept: wp.array[wp.vec4ui]): ...

    @wp.func_native(cuda_only(wide_lower.layers(spec, plan, by_rows), "return sums;"))
    def layers(memory: shared, sums: sums_type, kept: wp.array[wp.vec4ui], next: int, inside: bool) -> sums_type: ...

    dx_text = warpgroup_backward.input_gradient(spec, plan, wide.enter(spec, plan), rows_of)

    @wp.func_native(cuda_only(dx_text, "return {};"))
    def input_gradient(memory: shared) -> vec_in: ...

    finish = make_finish(wide_backward.finish(plan), shared, sums_type)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=plan.threads)
    def lower_kernel(
        params: Parameters,
        progress: Progress,
        micro: int,
        partial: wp.array2d[float],
        rows: wp.array2d[rows_of],
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
            if wp.static(by_rows):
                dx = input_gradient(memory)  # whole warps
                if lane < wp.static(lanes) and start + first < batch:
                    store(rows, start + first, dx)
        finish(memory, sums, 0.0, partial, progress.flags, step % 2, micro > 0)

    return lower_kernel
