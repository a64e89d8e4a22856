"""Where a training run is: the state that its kernels share."""

import warp as wp


@wp.struct
class Progress:
    """All on the device, so that a captured graph advances when it is replayed.

    counters: the step, as kernels of gradients read it and as those of updates do: each writes only the other's. By
    parity of the step: flags, a gradient is not finite; skipped, steps skipped before; good, steps since then, or minus
    those skipped in a row; scale, of the gradients. batch, rates: samples and learning rate of step i, the last stays.
    losses: the mean loss of step i at i % length.
    """

    counters: wp.array[int]
    flags: wp.array[int]
    skipped: wp.array[int]
    good: wp.array[int]
    scale: wp.array[float]
    batch: wp.array[int]
    rates: wp.array[float]
    losses: wp.array[float]
    seed: wp.uint64


@wp.func
def batch_of(progress: Progress, step: int) -> int:
    return progress.batch[wp.min(step, progress.batch.shape[0] - 1)]


@wp.func
def rate_of(progress: Progress, step: int) -> float:
    return progress.rates[wp.min(step, progress.rates.shape[0] - 1)]
