"""The optimizer kernel for gradients in one array: of every parameter, or of those that the fused one leaves."""

from functools import cache

import warp as wp

from kernels.encodings.base import UNROLL
from kernels.training.progress import Progress
from kernels.training.update import Rates, Update, advance, rates_of

GROUP = 4  # parameters that move through memory together, in 16 bytes
vec6 = wp.types.vector(6, float)

# loops of a known length, or the group would lie in memory
READ = f"""wp::vec_t<{GROUP}, wp::float32> group;
const wp::float32* const from = values.data + i;
#if defined(__CUDA_ARCH__)
if (i + {GROUP} <= values.shape[0]) {{
    const float4 q = *reinterpret_cast<const float4*>(from);
    group.c[0] = q.x; group.c[1] = q.y; group.c[2] = q.z; group.c[3] = q.w;
    return group;
}}
#endif{UNROLL}
for (int c = 0; c < {GROUP}; ++c) if (i + c < values.shape[0]) group.c[c] = from[c];
return group;
"""

WRITE = f"""wp::float32* const to = values.data + i;
#if defined(__CUDA_ARCH__)
if (i + {GROUP} <= values.shape[0]) {{
    *reinterpret_cast<float4*>(to) = make_float4(group.c[0], group.c[1], group.c[2], group.c[3]);
    return;
}}
#endif{UNROLL}
for (int c = 0; c < {GROUP}; ++c) if (i + c < values.shape[0]) to[c] = group.c[c];
"""


SKIP = f"""#if !defined(__CUDA_ARCH__)
for (; i >= passed && i + {GROUP} <= values.shape[0]; i += step) {{
    const wp::uint32* const bits = reinterpret_cast<const wp::uint32*>(values.data + i);
    if (((bits[0] | bits[1] | bits[2] | bits[3]) & 0x7fffffffu) != 0u) break;
}}
#endif
return i;
"""


@wp.func_native(SKIP)
def skip_zeros(values: wp.array[float], i: int, step: int, passed: int) -> int:
    """On the CPU, the first of the groups i, i + step, ... that lies before `passed`, is not zero or lies at the end.

    On CUDA i itself: the threads of a warp stay side by side.
    """
    ...


@wp.func_native(READ)
def read_group(values: wp.array[float], i: int) -> wp.vec4:
    """`values[i : i + 4]`, zeros after the last; i is a multiple of 4."""
    ...


@wp.func_native(WRITE)
def write_group(values: wp.array[float], i: int, group: wp.vec4): ...


LEADS = """#if defined(__CUDA_ARCH__)
return threadIdx.x == 0;
#else
return true;
#endif
"""

FROM_LEADER = """#if defined(__CUDA_ARCH__)
__shared__ wp::vec_t<6, wp::float32> first;
if (threadIdx.x == 0) first = values;
__syncthreads();
return first;
#else
return values;
#endif
"""


@wp.func_native(LEADS)
def leads_block() -> bool: ...


@wp.func_native(FROM_LEADER)
def from_leader(values: vec6) -> vec6: ...


@wp.func
def rates_of_block(progress: Progress, options: Update) -> Rates:
    """`rates_of`, once for all threads of a block, which wait for its first."""
    values = vec6()
    if leads_block():
        rates = rates_of(progress, options)
        skip = wp.where(rates.skip, 1.0, 0.0)
        values = vec6(skip, rates.rate, rates.corrections[0], rates.corrections[1], rates.mean, rates.decay)
    values = from_leader(values)
    shared = Rates()
    shared.skip = values[0] > 0.0
    shared.rate = values[1]
    shared.corrections = wp.vec2(values[2], values[3])
    shared.mean = values[4]
    shared.decay = values[5]
    return shared


@cache
def make_update_kernel(update: wp.Function) -> wp.Kernel:
    """From parameter `first`, a multiple of 4, on: gradients lie in `gradient`, which is cleared. dim threads, on CUDA
    whole blocks.

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
        rates = rates_of_block(progress, options)
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
