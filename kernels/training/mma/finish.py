"""CUDA text of the end of a fused training step: the gradients of all warps of a block, added up."""

from warp_neural.kernels.coopvec.cuda.fragments import unrolled
from warp_neural.kernels.training.mma.schedule import MmaLayer, MmaSchedule


def finish_text(schedule: MmaSchedule) -> str:
    """`(memory, sums, loss, partial, flags, parity, add) -> None`: the block's sum of gradients and of losses to
    `partial[block, :]`, in one order on every run; `flags[parity] = 1` if one is not finite. All threads."""
    checks = " + ".join(f"sums.c[{i}] * 0.0f" for i in range(schedule.sums))
    body = f"""using real = wp::float32;
const unsigned lane = threadIdx.x & 31u, g = lane >> 2, t = lane & 3u, warp = threadIdx.x >> 5;
real* const total = reinterpret_cast<real*>(memory.data.ptr);
real* const mine = partial.data + static_cast<size_t>(blockIdx.x) * {schedule.block_sums};
real all = loss;
for (int bit = 16; bit > 0; bit /= 2) all += __shfl_xor_sync(0xffffffffu, all, bit);
if (!(loss * 0.0f + {checks} == 0.0f)) flags.data[parity] = 1;
__syncthreads();
if (lane == 0) total[{schedule.copies}] = all;
{"".join(leave_sums(schedule, index) for index in range(len(schedule.layers)))}
__syncthreads();
{"".join(gather_sums(schedule, layer) for layer in schedule.layers)}
if (threadIdx.x == 0) {{
    all = add ? mine[{schedule.floats}] : 0.0f;
    for (int w = 0; w < {schedule.warps}; ++w) all += total[{schedule.copies} + w];
    mine[{schedule.floats}] = all;
}}
"""
    return unrolled(body.replace(f"total[{schedule.copies}] = all", f"total[{schedule.copies} + warp] = all"))


def leave_sums(schedule: MmaSchedule, index: int) -> str:
    """To shared memory: a copy of a layer's gradient for each split, of its biases' for each column group too."""
    layer = schedule.layers[index]
    rows, columns, groups = layer.rows, layer.columns, layer.column_groups
    return f"""if (warp < {layer.tasks * layer.splits}u) {{
const unsigned task = warp % {layer.tasks}u, split = warp / {layer.tasks}u;
const unsigned n0 = task / {groups}u * {rows}, b0 = task % {groups}u * {columns};
for (int i = 0; i < {rows}; ++i) for (int c = 0; c < {columns}; ++c) for (int side = 0; side < 2; ++side) {{
    const real* const dw = sums.c + {layer.sums} + ((i * {columns} + c) * 2 + side) * 4;
    const unsigned tile = ((n0 + i) * {layer.k_blocks} + b0 + c) * 2 + side;
    reinterpret_cast<float4*>(total + {layer.copies} + split * {layer.weight_floats} + tile * 128)[lane]
        = make_float4(dw[0], dw[1], dw[2], dw[3]);
}}
if (t == {index % 8 // 2}) for (int i = 0; i < {rows}; ++i) for (int half = 0; half < 2; ++half)
    total[{layer.bias_copies} + ((split * {groups} + task % {groups}u) * {layer.n_blocks} + n0 + i) * 16 + half * 8 + g]
        = sums.c[{schedule.bias_sums(index)} + i * 4 + 2 * half + {index % 2}];
}}
"""


def gather_sums(schedule: MmaSchedule, layer: MmaLayer) -> str:
    text = ""
    for first, size, copies, count in (
        (layer.first, layer.weight_floats, layer.copies, layer.splits),
        (layer.bias_first, layer.n_blocks * 16, layer.bias_copies, layer.splits * layer.column_groups),
    ):
        text += f"""for (unsigned i = threadIdx.x; i < {size}u; i += {schedule.threads}u) {{
    real sum = add ? mine[{first} + i] : 0.0f;
    for (int copy = 0; copy < {count}; ++copy) sum += total[{copies} + copy * {size} + i];
    mine[{first} + i] = sum;
}}
"""
    return text
