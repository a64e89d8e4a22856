"""CUDA text of the end of a fused training step by warpgroups: the sums of a block."""

from pathlib import Path

from warp_neural.kernels.native import paste
from warp_neural.kernels.training.hopper64.schedule import SAMPLES, WIDTH, Hopper64Schedule, HopperSchedule
from warp_neural.kernels.training.text import finish_names

NATIVE = Path(__file__).parent / "native"


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
    return f"""{enter_finish(schedule, checked)}__syncthreads();
{leave}{leave_last(schedule, base, final.bias_sums)}__syncthreads();
{put}{put_last(schedule)}"""


def enter_finish(schedule: HopperSchedule, checked: list[int]) -> str:
    """Names, `put(i, v)` for what a block leaves, and a check of sums that all have to be finite."""
    values = [f"sums.c[{i}] * 0.0f" for i in checked]
    checks = " + ".join(f"({' + '.join(values[i::8] or ['0.0f'])})" for i in range(8))
    return f"""{finish_names(schedule, f"loss * 0.0f + {checks}")}
const unsigned group = warp >> 2, place = threadIdx.x & 127u;
auto put = [&](unsigned i, real v) {{ mine[i] = add ? mine[i] + v : v; }};
"""


def leave_last(schedule: HopperSchedule, base: int, bias_sums: int) -> str:
    """To shared memory from `base` on: the last layer's biases and losses."""
    return paste(NATIVE / "leave_last.cuh", BASE=base, N=schedule.layers[-1].layout.n, BIAS_SUMS=bias_sums)


def put_last(schedule: HopperSchedule) -> str:
    return paste(NATIVE / "put_last.cuh", BIAS_FIRST=schedule.layers[-1].bias_first, FLOATS=schedule.floats)
