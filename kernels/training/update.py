"""The optimizer kernel of a fused step: the sums of its blocks, added up and scaled back, to new parameters."""

from functools import cache
from pathlib import Path

import warp as wp

from warp_neural.kernels.coopvec.formats import make_encode
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.kernels.training.progress import Progress, batch_of, rate_of
from warp_neural.kernels.training.schedule import Schedule

NATIVE = Path(__file__).parent / "native"

COLUMNS = 32  # parameters of one block: as many lanes of each warp read one block's gradients, side by side


def adders(schedule: Schedule) -> int:
    """Warps of a block that add up block sums: warp w those of blocks w, w + adders, ... More are faster as long as all
    fit at once."""
    return 16 if schedule.floats < 128 * COLUMNS else 8


def update_block(schedule: Schedule) -> int:
    """Threads of a block: a warp that updates, and `adders`."""
    return COLUMNS * (1 + adders(schedule))


@cache
def make_sum_of_column(adders: int) -> wp.Function:
    """`(partial, column) -> sum over the rows`, to the first warp of a block; `adders` more read them."""

    held = 136 // adders + 1  # loads under way: with up to 136 blocks, all

    @wp.func_native(paste(NATIVE / "sum_of_column.cuh", COLUMNS=COLUMNS, ADDERS=adders, HELD=held))
    def sum_of_column(partial: wp.array2d[float], column: int) -> float: ...

    return sum_of_column


@wp.func_native("reinterpret_cast<unsigned short*>(packed.data)[element] = static_cast<unsigned short>(bits);\n")
def store_half(packed: wp.array[wp.uint32], element: int, bits: wp.uint32): ...


@wp.struct
class Update:
    """settings, first, second: of the optimizer. dynamic: the scale of gradients adapts. batches: of a step, whose
    gradients were added. average: of the parameters, decaying by `decay` a step; empty: none is kept.
    """

    settings: wp.vec4
    first: wp.array[float]
    second: wp.array[float]
    dynamic: bool
    batches: int
    average: wp.array[float]
    decay: float


@wp.struct
class Rates:
    """What all parameters of a step share; mean: what the sum of scaled gradients is multiplied by."""

    skip: bool
    rate: float
    corrections: wp.vec2
    mean: float
    decay: float


@wp.func
def rates_of(progress: Progress, options: Update) -> Rates:
    step = progress.counters[1]
    parity = step % 2
    t = float(step + 1 - progress.skipped[parity])
    rates = Rates()
    rates.skip = progress.flags[parity] > 0
    rates.rate = rate_of(progress, step)
    rates.corrections = wp.vec2(
        1.0 / (1.0 - wp.pow(options.settings[0], t)), 1.0 / (1.0 - wp.pow(options.settings[1], t))
    )
    rates.mean = 1.0 / (progress.scale[parity] * float(batch_of(progress, step) * options.batches))
    # the mean so far of the first steps, then exponential: no bias towards the start
    rates.decay = wp.min(options.decay, 1.0 - 1.0 / t)
    return rates


@wp.func
def store(i: int, state: wp.vec3, rates: Rates, options: Update, master: wp.array[float]):
    """A parameter and its moments after a step."""
    master[i] = state[0]
    options.second[i] = state[2]
    options.first[i] = state[1]  # the same array as `second` for `sgd`
    if options.average.shape[0] > 0:
        options.average[i] = rates.decay * options.average[i] + (1.0 - rates.decay) * state[0]


@wp.func
def advance(progress: Progress, dynamic: bool):
    """To the next step; by one thread. The scale of gradients halves after a skipped step, and doubles after 2,000 good
    ones (Micikevicius et al. 2018, section 3.2)."""
    step = progress.counters[1]
    now = step % 2
    later = 1 - now
    bad = progress.flags[now]
    good = wp.where(bad > 0, wp.min(progress.good[now], 0) - 1, wp.max(progress.good[now], 0) + 1)
    scale = progress.scale[now]
    if dynamic and bad > 0:
        scale = wp.max(scale * 0.5, 1.0)
    if dynamic and good == 2000:
        scale = wp.min(scale * 2.0, 65536.0)
        good = 0
    progress.scale[later] = scale
    progress.good[later] = good
    progress.flags[later] = 0
    progress.skipped[later] = progress.skipped[now] + bad
    progress.losses[(step + 1) % progress.losses.shape[0]] = 0.0
    progress.counters[0] = step + 1


@cache
def make_fused_update_kernel(update: wp.Function, spec: NetworkSpec, schedule: Schedule) -> wp.Kernel:
    """After `make_gradient_kernel`: dim ceil((schedule.floats + 1) / COLUMNS) * update_block(schedule).

    order: which parameter each column of `partial` is (-1: padding). target: where the parameter lies in `packed`, in
    16-bit elements; ~word for a float32 bias.
    """
    encode, floats, block = make_encode(spec.format), wp.constant(schedule.floats), update_block(schedule)
    sum_of_column = make_sum_of_column(adders(schedule))

    @wp.kernel(module="unique", enable_backward=False)
    def update_kernel(
        progress: Progress,
        options: Update,
        partial: wp.array2d[float],
        order: wp.array[int],
        target: wp.array[int],
        master: wp.array[float],
        packed: wp.array[wp.uint32],
    ):
        thread = wp.tid()
        updates = thread % wp.static(block) < wp.static(COLUMNS)
        column = thread / wp.static(block) * wp.static(COLUMNS) + thread % wp.static(COLUMNS)
        # while the other warps wait for memory
        i = int(-1)
        place = int(0)
        state = wp.vec3()
        rates = Rates()
        if updates:
            i = order[wp.min(column, floats - 1)]
            at = wp.max(i, 0)
            place = target[at]
            state = wp.vec3(master[at], options.first[at], options.second[at])
            rates = rates_of(progress, options)
            if column >= floats:
                i = -1
        g = sum_of_column(partial, column) * rates.mean
        if updates and column == floats:  # the losses' sum is not scaled
            step = progress.counters[1]
            progress.losses[step % progress.losses.shape[0]] = g * progress.scale[step % 2]
            advance(progress, options.dynamic)
        if i >= 0 and not rates.skip:
            state = update(g, state, rates.rate, rates.corrections, options.settings)
            store(i, state, rates, options, master)
            if place >= 0:
                store_half(packed, place, encode(state[0]))
            else:
                packed[~place] = wp.cast(state[0], wp.uint32)

    return update_kernel
