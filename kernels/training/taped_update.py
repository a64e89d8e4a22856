"""The optimizer kernel for gradients in one array: of every parameter, or of those that the fused one leaves."""

from functools import cache
from pathlib import Path

import warp as wp

from warp_neural.kernels.native import paste
from warp_neural.kernels.training.progress import Progress
from warp_neural.kernels.training.update import Update, advance, rates_of

NATIVE = Path(__file__).parent / "native"

GROUP = 4  # parameters that move through memory together, in 16 bytes


@wp.func_native(paste(NATIVE / "skip_zeros.h", GROUP=GROUP))
def skip_zeros(values: wp.array[float], i: int, step: int, passed: int) -> int:
    """On the CPU, the first of the groups i, i + step, ... that lies before `passed`, is not zero or lies at the end.

    On CUDA i itself: the threads of a warp stay side by side.
    """
    ...


@wp.func_native(paste(NATIVE / "read_group.h", GROUP=GROUP))
def read_group(values: wp.array[float], i: int) -> wp.vec4:
    """`values[i : i + 4]`, zeros after the last; i is a multiple of 4."""
    ...


@wp.func_native(paste(NATIVE / "write_group.h", GROUP=GROUP))
def write_group(values: wp.array[float], i: int, group: wp.vec4): ...


@wp.kernel(module="unique", enable_backward=False)
def check_kernel(progress: Progress, gradient: wp.array[float], threads: int):
    """Flag the step if the gradient is not finite. dim threads."""
    finite = bool(True)
    i = wp.static(GROUP) * wp.tid()
    while i < gradient.shape[0]:
        finite = finite and wp.isfinite(read_group(gradient, i))
        i += wp.static(GROUP) * threads
    if not finite:
        progress.flags[progress.counters[1] % 2] = 1


@cache
def make_update_kernel(update: wp.Function) -> wp.Kernel:
    """From parameter `first`, a multiple of 4, on: gradients lie in `gradient`, which is cleared. dim threads.

    sparse: the first parameter that rests, and so do its moments, if its gradient is exactly 0 (see `Encoding.sparse`),
    a multiple of 4 or the end. last: of the step.
    """

    @wp.kernel(module="unique", enable_backward=False)
    def update_kernel(
        progress: Progress,
        options: Update,
        first: int,
        sparse: int,
        last: bool,
        threads: int,
        gradient: wp.array[float],
        master: wp.array[float],
    ):
        thread = wp.tid()
        averages = options.average.shape[0] > 0
        step = wp.static(GROUP) * threads
        passed = wp.where(averages, master.shape[0], sparse)
        i = skip_zeros(gradient, first + wp.static(GROUP) * thread, step, passed)
        g = read_group(gradient, i)
        rates = rates_of(progress, options)
        while i < master.shape[0]:
            reached = not (g == wp.vec4())
            moves = reached or i < sparse
            if not rates.skip and (moves or averages):
                values = read_group(master, i)
                if moves:
                    m = read_group(options.first, i)
                    v = read_group(options.second, i)
                    for c in range(wp.static(GROUP)):
                        if i < sparse or g[c] != 0.0:
                            state = wp.vec3(values[c], m[c], v[c])
                            state = update(g[c] * rates.mean, state, rates.rate, rates.corrections, options.settings)
                            values[c] = state[0]
                            m[c] = state[1]
                            v[c] = state[2]
                    write_group(master, i, values)
                    write_group(options.second, i, v)
                    write_group(options.first, i, m)  # the same array as `second` for `sgd`
                if averages:
                    past = read_group(options.average, i)
                    write_group(options.average, i, rates.decay * past + (1.0 - rates.decay) * values)
            if reached:
                write_group(gradient, i, wp.vec4())
            i = skip_zeros(gradient, i + step, step, passed)
            g = read_group(gradient, i)
        if last and thread == 0:
            advance(progress, options.dynamic)

    return update_kernel
