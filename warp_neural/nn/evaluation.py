"""Networks of rows of memory: which kernel evaluates them, and its launch."""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.cuda.warpgroup_rows import RowsSchedule, make_rows_schedule
from warp_neural.kernels.coopvec.rows import BLOCK, make_evaluate_kernel, make_warpgroup_kernel
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters, round_up
from warp_neural.nn.functions import Functions
from warp_neural.nn.loading import load_for


def schedule_of(net: Functions, x: wp.array) -> RowsSchedule | None:
    """How warpgroups evaluate the rows of x; None: each warp for itself."""
    device, plain = x.device, net.encoding is None and net.implementation == "cooperative"
    if not device.is_cuda or not plain or (x.ptr | x.strides[0]) % 16 or x.strides[1] != 2:
        return None
    return make_rows_schedule(net.spec, device.arch, device.max_shared_memory_per_block)


@cache
def load_kernel(spec: NetworkSpec, schedule: RowsSchedule, alias: str) -> wp.Kernel:
    """Loaded on the device of that name."""
    kernel = make_warpgroup_kernel(spec, schedule)
    load_for(kernel, schedule, wp.get_device(alias))
    return kernel


def launch_rows(net: Functions, params: Parameters, x: wp.array, y: wp.array) -> None:
    """`params.network` of each row of x [n, n_in], to y [n, n_out], dense."""
    schedule = schedule_of(net, x)
    if schedule:
        launch_warpgroups(net.spec, schedule, params, x, y)
    else:
        kernel, dim = make_evaluate_kernel(net.plain_of_row, net.vec_out), round_up(x.shape[0], BLOCK)
        wp.launch(kernel, dim, [params, x, y], device=x.device, block_dim=BLOCK, record_tape=False)


def launch_warpgroups(spec: NetworkSpec, schedule: RowsSchedule, params: Parameters, x: wp.array, y: wp.array) -> None:
    """The same by a schedule; x as `schedule_of` asks."""
    device = x.device
    blocks = min(device.sm_count * schedule.blocks, -(-x.shape[0] // schedule.block_rows))
    kernel = load_kernel(spec, schedule, device.alias)
    dim = blocks * schedule.threads
    wp.launch(kernel, dim, [params, x, y], device=device, block_dim=schedule.threads, record_tape=False)
