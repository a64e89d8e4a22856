"""CUDA text of the end of a fused training step: the gradients of all warps of a block, added up."""

from pathlib import Path

from warp_neural.kernels.native import paste
from warp_neural.kernels.training.mma.schedule import MmaLayer, MmaSchedule
from warp_neural.kernels.training.text import finish_names

NATIVE = Path(__file__).parent / "native"


def finish_text(schedule: MmaSchedule) -> str:
    """`(memory, sums, loss, partial, flags, parity, add) -> None`: the block's sum of gradients and of losses to
    `partial[block, :]`, in one order on every run; `flags[parity] = 1` if one is not finite. All threads."""
    checks = " + ".join(f"sums.c[{i}] * 0.0f" for i in range(schedule.sums))
    return f"""{finish_names(schedule, f"loss * 0.0f + {checks}")}
real all = loss;
UNROLL for (int bit = 16; bit > 0; bit /= 2) all += __shfl_xor_sync(0xffffffffu, all, bit);
__syncthreads();
if (lane == 0) total[{schedule.copies} + warp] = all;
{"".join(leave_sums(schedule, index) for index in range(len(schedule.layers)))}
__syncthreads();
{"".join(gather_sums(schedule, layer) for layer in schedule.layers)}
if (threadIdx.x == 0) {{
    all = add ? mine[{schedule.floats}] : 0.0f;
    UNROLL for (int w = 0; w < {schedule.warps}; ++w) all += total[{schedule.copies} + w];
    mine[{schedule.floats}] = all;
}}
"""


def leave_sums(schedule: MmaSchedule, index: int) -> str:
    """To shared memory."""
    layer = schedule.layers[index]
    where = {"COPIES": layer.copies, "BIAS_COPIES": layer.bias_copies}
    return f"{{ {paste(NATIVE / 'leave_sums.cuh', **schedule.constants(index), **where)}}}\n"


def gather_sums(schedule: MmaSchedule, layer: MmaLayer) -> str:
    weights = {"FIRST": layer.first, "SIZE": layer.weight_floats, "COPIES": layer.copies, "COUNT": layer.splits}
    biases = {"FIRST": layer.bias_first, "SIZE": layer.n_blocks * 16, "COPIES": layer.bias_copies}
    biases["COUNT"] = layer.splits * layer.column_groups
    both = (paste(NATIVE / "gather_sums.cuh", THREADS=schedule.threads, **sums) for sums in (weights, biases))
    return "".join(f"{{ {text}}}\n" for text in both)
