"""CUDA text of the lower pass of a fused training step for 128 neurons a layer, after `wide_backward`.

What the upper pass kept comes from memory while the products of the other slots are under way.
"""

from warp_neural.kernels.coopvec.cuda.fragments import unrolled
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.hopper64.backward import back_word
from warp_neural.kernels.training.hopper64.forward import wait, wgmma
from warp_neural.kernels.training.hopper128.backward import (
    back_tile,
    input_tile,
    save_dx,
    weight_multiply,
    weight_products,
)
from warp_neural.kernels.training.hopper128.forward import BLOCKS, enter
from warp_neural.kernels.training.hopper128.schedule import PANEL, SLOT, LowerPlan


def fetch(plan: LowerPlan) -> str:
    """A lambda: from memory to slots `begin` to `end`, under way; of the round `start`, if `inside`."""
    return f"""auto fetch = [&](int start, bool inside, unsigned begin, unsigned end) {{
    const size_t tile = start / 64 + blockIdx.x * 2 + group;
    const char* const memory_of = reinterpret_cast<const char*>(kept.data) + tile * {plan.kept * SLOT};
    if (inside)
        for (unsigned at = begin + (threadIdx.x & 127u) * 16; at < end; at += 128 * 16)
            asm volatile("cp.async.cg.shared.global [%0],[%1],16;" :: "r"(area + at), "l"(memory_of + at) : "memory");
    asm volatile("cp.async.commit_group;" ::: "memory"); }};
"""


def parts(plan: LowerPlan) -> list[tuple[int, int]]:
    """Bytes of an area that are fetched together: of the first slots, and of the input's."""
    x = plan.h(0)
    return [(0, x), (x, x + plan.layers[0].panels * PANEL)]


def arrived(pending: int) -> str:
    """Fetched by all threads of the block, but for `pending` parts."""
    return f'asm volatile("cp.async.wait_group {pending};" ::: "memory");\npublish();\n__syncthreads();\n'


def begin(spec: NetworkSpec, plan: LowerPlan) -> str:
    """`(memory, kept)`: the first tile, under way."""
    fetches = "".join(f"fetch(0, true, {begin}u, {end}u);\n" for begin, end in parts(plan))
    return unrolled(enter(spec, plan) + fetch(plan) + fetches)


def layers(spec: NetworkSpec, plan: LowerPlan, input_gradient: bool) -> str:
    """`(memory, sums, kept, next, inside) -> sums`: dW of all layers of the pass; `input_gradient` leaves dx. next: the
    start of the next round, if `inside`. All threads."""
    lambdas = "".join(weight_multiply(spec, plan, index) for index in plan.gradients)
    refill, refill_x = (f"fetch(next, inside, {begin}u, {end}u);\n" for begin, end in parts(plan))
    before, after, ready = arrived(0), refill + refill_x, ["sum.c"]
    if plan.low > 1:
        lambdas += wgmma("multiply_back", spec, 64, "rows", True)
        before, after = f"{arrived(1)}{back_layer(spec, plan, 1)}{arrived(0)}{refill}", refill_x
    dx = ""
    if input_gradient:
        k_pad = plan.layers[0].layout.k_pad
        lambdas += wgmma("multiply_input", spec, k_pad, "rows", True)
        dx = f"""real dh[{k_pad // 2}];
for (int b = 0; b < {BLOCKS}; ++b) multiply_input(dh, {dz_tile(plan, 0)}, {input_tile(plan)}, b);
"""
        ready, after = ["sum.c", "dh"], after + save_dx(plan)
    return unrolled(f"""{enter(spec, plan)}{fetch(plan)}{lambdas}
auto sum = sums;
{before}begin_products();
{dx}{weight_products(plan, 0)}commit();
{wait(0, *ready)}__syncthreads();
{after}return sum;
""")


def back_layer(spec: NetworkSpec, plan: LowerPlan, index: int) -> str:
    """dz of the layer before to its slot, half by half, while dW of layer `index` is summed."""
    word = back_word(spec, "dh[half][8 * i + 2 * r", "was[i][r]")
    return f"""{{ real dh[2][32];
begin_products();
for (int half = 0; half < 2; ++half) {{
    for (int b = 0; b < {BLOCKS}; ++b) multiply_back(dh[half], {dz_tile(plan, index)}, {back_tile(plan, index)}, b);
    commit();
}}
{weight_products(plan, index)}commit();
for (int half = 0; half < 2; ++half) {{
unsigned was[4][4], w[4];
for (int i = 0; i < 4; ++i) load(matrices({plan.h(index)}, 4 * half + i), was[i]);
if (half == 0) {{ {wait(2, "dh[0]")} }} else {{ {wait(1, "dh[1]")} }}
for (int i = 0; i < 4; ++i) {{
    for (int r = 0; r < 4; ++r) w[r] = {word};
    save(matrices({plan.dz(index - 1)}, 4 * half + i), w);
}} }}
{wait(0, "sum.c")}}}
"""


def dz_tile(plan: LowerPlan, index: int) -> str:
    """Columns 16 b on of this warpgroup's dz of layer `index`."""
    return f"tile(area + {plan.dz(index)} + b / 4 * {PANEL} + 32 * (b % 4), 0u)"
