"""The optimizer kernel for gradients in one array: of every parameter, or of those that the fused one leaves."""

from functools import cache

import warp as wp

from kernels.training.progress import Progress
from kernels.training.update import Update, advance, rates_of

GROUP = 4  # parameters that move through memory together, in 16 bytes
GROUPS = 2  # that a thread moves at a time: more bytes under way, but more registers, and so fewer threads
ALL = (1 << GROUPS) - 1
Groups = wp.types.vector(GROUP * GROUPS, wp.float32)


def for_chosen(whole: str, element: str) -> str:
    """`whole` moves group k at j on CUDA; `element`, its element c, where the array ends within it and on the CPU."""
    return f"""using real = wp::float32;
#if defined(__CUDA_ARCH__)
const int cut = values.shape[0] & -{GROUP};
#pragma unroll
for (int k = 0; k < {GROUPS}; ++k) {{
    const int j = i + k * step;
    if ((chosen >> k & 1) && j < cut) {{ {whole} }}
}}
#else
const int cut = 0;
#endif
#pragma unroll
for (int k = 0; k < {GROUPS}; ++k) {{
    const int j = i + k * step;
    if ((chosen >> k & 1) && j >= cut) for (int c = 0; c < {GROUP} && j + c < values.shape[0]; ++c) {{ {element} }}
}}
"""


PART = f"real* const part = groups.c + k * {GROUP}; "
LOAD = "const float4 q = *reinterpret_cast<const float4*>(values.data + j); "
LOAD += "part[0] = q.x; part[1] = q.y; part[2] = q.z; part[3] = q.w;"
STORE = "*reinterpret_cast<float4*>(values.data + j) = make_float4(part[0], part[1], part[2], part[3]);"
READ = for_chosen(PART + LOAD, f"groups.c[k * {GROUP} + c] = values.data[j + c];")
WRITE = for_chosen(PART + STORE, f"values.data[j + c] = groups.c[k * {GROUP} + c];")

SKIP = f"""#if !defined(__CUDA_ARCH__)
for (; i >= sparse && i + {GROUP} <= values.shape[0]; i += {GROUP}) {{
    const wp::uint32* const bits = reinterpret_cast<const wp::uint32*>(values.data + i);
    if (((bits[0] | bits[1] | bits[2] | bits[3]) & 0x7fffffffu) != 0u) break;
}}
#endif
return i;
"""


@wp.func_native(SKIP)
def skip_zeros(values: wp.array[float], i: int, sparse: int) -> int:
    """On the CPU, from `sparse` on, the first of the groups from i on that is not zero, or lies at the end.

    On CUDA i itself: the threads of a warp stay side by side.
    """
    ...


@wp.func_native(f"wp::vec_t<{GROUP * GROUPS}, wp::float32> groups;\n{READ}return groups;\n")
def read_groups(values: wp.array[float], i: int, step: int, chosen: int) -> Groups:
    """`values[j : j + 4]` for j = i, i + step, ...: those that are chosen, by bits, zeros after the last.

    i and step are multiples of 4.
    """
    ...


@wp.func_native(WRITE)
def write_groups(values: wp.array[float], i: int, step: int, chosen: int, groups: Groups): ...


@wp.func
def reached_of(g: Groups) -> int:
    """The groups that are not zero, by bits."""
    reached = int(0)
    for e in range(wp.static(GROUP * GROUPS)):
        if g[e] != 0.0:
            reached |= 1 << e / wp.static(GROUP)
    return reached


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
        step = wp.static(GROUP) * threads
        averages = options.average.shape[0] > 0
        passed = wp.where(averages, master.shape[0], sparse)
        i = skip_zeros(gradient, first + wp.static(GROUP) * thread, passed)
        following = read_groups(gradient, i, step, ALL)
        rates = rates_of(progress, options)
        while i < master.shape[0]:
            g = following
            after = skip_zeros(gradient, i + wp.static(GROUPS) * step, passed)
            following = read_groups(gradient, after, step, ALL)  # early: the others wait for it
            reached = reached_of(g)
            moves = reached
            for k in range(wp.static(GROUPS)):
                if i + k * step < sparse:
                    moves |= 1 << k
            if not rates.skip and (moves > 0 or averages):
                values = read_groups(master, i, step, wp.where(averages, ALL, moves))
                m = read_groups(options.first, i, step, moves)
                v = read_groups(options.second, i, step, moves)
                for e in range(wp.static(GROUP * GROUPS)):
                    if i + e / wp.static(GROUP) * step < sparse or g[e] != 0.0:
                        state = wp.vec3(values[e], m[e], v[e])
                        state = update(g[e] * rates.mean, state, rates.rate, rates.corrections, options.settings)
                        values[e] = state[0]
                        m[e] = state[1]
                        v[e] = state[2]
                write_groups(master, i, step, moves, values)
                write_groups(options.second, i, step, moves, v)
                write_groups(options.first, i, step, moves, m)  # the same array as `second` for `sgd`
                if averages:
                    past = read_groups(options.average, i, step, ALL)
                    average = rates.decay * past + (1.0 - rates.decay) * values
                    write_groups(options.average, i, step, ALL, average)
            write_groups(gradient, i, step, reached, Groups())
            i = after
        if last and thread == 0:
            advance(progress, options.dynamic)

    return update_kernel
