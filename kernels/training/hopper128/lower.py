"""CUDA text of the lower pass of a fused training step for 128 neurons a layer, after `hopper128.backward`.

What the upper pass kept comes from memory while the products of the other slots are under way.
"""

from pathlib import Path

from warp_neural.kernels.coopvec.cuda.warpgroups import wait, wgmma
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.backward import back_word
from warp_neural.kernels.training.hopper128.backward import (
    back_tile,
    input_tile,
    save_dx,
    weight_multiply,
    weight_products,
)
from warp_neural.kernels.training.hopper128.forward import BLOCKS, enter
from warp_neural.kernels.training.hopper128.schedule import PANEL, SLOT, Hopper128LowerSchedule

NATIVE = Path(__file__).parent / "native"


def fetch(schedule: Hopper128LowerSchedule) -> str:
    """A lambda, after `enter`: from memory to slots `begin` to `end`, under way; of the round `start`, if `inside`."""
    return paste(NATIVE / "fetch.cuh", KEPT=schedule.kept * SLOT)


def fetched(schedule: Hopper128LowerSchedule) -> list[tuple[int, int]]:
    """Bytes of an area that are fetched together: of the first slots, and of the input's."""
    x = schedule.h(0)
    return [(0, x), (x, x + schedule.layers[0].panels * PANEL)]


def arrived(pending: int) -> str:
    """Fetched by all threads of the block, but for `pending` parts."""
    return f'asm volatile("cp.async.wait_group {pending};" ::: "memory");\npublish();\n__syncthreads();\n'


def fetch_text(spec: NetworkSpec, schedule: Hopper128LowerSchedule) -> str:
    """`(memory, kept)`: the first tile, under way."""
    fetches = "".join(f"fetch(0, true, {begin}u, {end}u);\n" for begin, end in fetched(schedule))
    return enter(spec, schedule) + fetch(schedule) + fetches


def lower_layers_text(spec: NetworkSpec, schedule: Hopper128LowerSchedule, input_gradient: bool) -> str:
    """`(memory, sums, kept, next, inside) -> sums`: dW of all layers of the pass; `input_gradient` leaves dx. next: the
    start of the next round, if `inside`. All threads."""
    lambdas = "".join(weight_multiply(spec, schedule, index) for index in schedule.gradients)
    refill, refill_x = (f"fetch(next, inside, {begin}u, {end}u);\n" for begin, end in fetched(schedule))
    before, after, ready = arrived(0), refill + refill_x, ["sum.c"]
    if schedule.low > 1:
        lambdas += wgmma("multiply_back", spec, 64, "rows", True)
        before, after = f"{arrived(1)}{back_layer(spec, schedule, 1)}{arrived(0)}{refill}", refill_x
    dx = ""
    if input_gradient:
        k_pad = schedule.layers[0].layout.k_pad
        lambdas += wgmma("multiply_input", spec, k_pad, "rows", True)
        dx = f"""real dh[{k_pad // 2}];
UNROLL for (int b = 0; b < {BLOCKS}; ++b) multiply_input(dh, {dz_tile(schedule, 0)}, {input_tile(schedule)}, b);
"""
        ready, after = ["sum.c", "dh"], after + save_dx(schedule)
    return f"""{enter(spec, schedule)}{fetch(schedule)}{lambdas}
auto sum = sums;
{before}begin_products();
{dx}{weight_products(schedule, 0)}commit();
{wait(0, *ready)}__syncthreads();
{after}return sum;
"""


def back_layer(spec: NetworkSpec, schedule: Hopper128LowerSchedule, index: int) -> str:
    """dz of the layer before to its slot, half by half, while dW of layer `index` is summed."""
    word = back_word(spec, "dh[half][8 * i + 2 * r", "was[i][r]")
    return f"""{{ real dh[2][32];
begin_products();
UNROLL for (int half = 0; half < 2; ++half) {{
    UNROLL for (int b = 0; b < {BLOCKS}; ++b)
        multiply_back(dh[half], {dz_tile(schedule, index)}, {back_tile(schedule, index)}, b);
    commit();
}}
{weight_products(schedule, index)}commit();
UNROLL for (int half = 0; half < 2; ++half) {{
unsigned was[4][4], w[4];
UNROLL for (int i = 0; i < 4; ++i) load(matrices({schedule.h(index)}, 4 * half + i), was[i]);
if (half == 0) {{ {wait(2, "dh[0]")} }} else {{ {wait(1, "dh[1]")} }}
UNROLL for (int i = 0; i < 4; ++i) {{
    UNROLL for (int r = 0; r < 4; ++r) w[r] = {word};
    save(matrices({schedule.dz(index - 1)}, 4 * half + i), w);
}} }}
{wait(0, "sum.c")}}}
"""


def dz_tile(schedule: Hopper128LowerSchedule, index: int) -> str:
    """Columns 16 b on of this warpgroup's dz of layer `index`."""
    return f"tile(area + {schedule.dz(index)} + b / 4 * {PANEL} + 32 * (b % 4), 0u)"
