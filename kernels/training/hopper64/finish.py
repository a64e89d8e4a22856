"""CUDA text of the end of a fused training step by warpgroups: the sums of a block."""

from warp_neural.kernels.coopvec.cuda.fragments import unrolled
from warp_neural.kernels.training.hopper64.schedule import SAMPLES, WIDTH, Hopper64Schedule, HopperSchedule


def finish_text(schedule: Hopper64Schedule) -> str:
    """As `mma.finish.finish_text`. Each warpgroup adds up half of the weights' registers of both."""
    registers = [
        (layer.sums + r, layer.first + SAMPLES * r) for layer in schedule.layers for r in range(layer.registers)
    ]
    half, base = len(registers) // 2, len(registers) * SAMPLES
    final = schedule.layers[-1]
    checked = [sum for sum, _ in registers] + [final.bias_sums]
    checked += [layer.bias_sums + r for layer in schedule.layers[:-1] for r in (0, 2)]
    leave = put = ""
    for i, (sum, first) in enumerate(registers):
        leave += f"if (group == {int(i < half)}u) total[{i * SAMPLES} + place] = sums.c[{sum}];\n"
        put += f"if (group == {int(i >= half)}u) put({first} + place, sums.c[{sum}] + total[{i * SAMPLES} + place]);\n"
    for layer in schedule.layers[:-1]:
        for h in range(2):
            row = f"group * {WIDTH} + place / 32u * 16u + g + {8 * h}"
            leave += f"if (t == 0u) total[{base} + {row}] = sums.c[{layer.bias_sums + 2 * h}];\n"
        value = f"total[{base} + place] + total[{base + WIDTH} + place]"
        put += f"if (threadIdx.x < {WIDTH}u) put({layer.bias_first} + place, {value});\n"
        base += 2 * WIDTH
    return unrolled(f"""{enter_finish(schedule, checked)}__syncthreads();
{leave}{leave_last(schedule, base, final.bias_sums)}__syncthreads();
{put}{put_last(schedule, base)}""")


def enter_finish(schedule: HopperSchedule, checked: list[int]) -> str:
    """Names, `put(i, v)` for what a block leaves, and a check of sums that all have to be finite."""
    values = [f"sums.c[{i}] * 0.0f" for i in checked]
    checks = " + ".join(f"({' + '.join(values[i::8] or ['0.0f'])})" for i in range(8))
    return f"""using real = wp::float32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u, warp = threadIdx.x >> 5;
const unsigned group = warp >> 2, place = threadIdx.x & 127u;
real* const total = reinterpret_cast<real*>(memory.data.ptr);
real* const mine = partial.data + static_cast<size_t>(blockIdx.x) * {schedule.block_sums};
auto put = [&](unsigned i, real v) {{ mine[i] = add ? mine[i] + v : v; }};
if (!(loss * 0.0f + {checks} == 0.0f)) flags.data[parity] = 1;
"""


def leave_last(schedule: HopperSchedule, base: int, bias_sums: int) -> str:
    """To shared memory: of each of the last layer's biases, as `start` dealt them, and of losses, two floats a warp."""
    n_out = schedule.layers[-1].layout.n
    return f"""real all = loss;
for (int bit = 16; bit > 1; bit /= 2) all += __shfl_xor_sync(0xffffffffu, all, bit);
if (lane / 2u < {n_out}u) total[{base} + lane / 2u * 16u + 2u * warp + lane % 2u] = sums.c[{bias_sums}];
if (lane < 2u) total[{base + 16 * n_out} + 2u * warp + lane] = all;
"""


def put_last(schedule: HopperSchedule, base: int) -> str:
    final = schedule.layers[-1]
    return f"""if (threadIdx.x <= {final.layout.n}u) {{
    all = 0.0f;
    for (int i = 0; i < 16; ++i) all += total[{base} + threadIdx.x * 16u + i];
    put(threadIdx.x < {final.layout.n}u ? {final.bias_first} + threadIdx.x : {schedule.floats}u, all);
}}
"""
