"""The arrays of a run that its kernels read and write, beside those of the network."""

import numpy as np
import warp as wp

from warp_neural.kernels.training.progress import Progress
from warp_neural.kernels.training.update import Update
from warp_neural.train.optim import SGD, Adam

HISTORY = 1 << 14  # steps whose loss is kept on the device


def make_progress(optimizer: Adam | SGD, sizes: np.ndarray, scale: float, seed: int) -> Progress:
    """At step 0. sizes: of the batches of the steps to come; scale: of gradients."""
    progress, device = Progress(), optimizer.first.device
    for name in ("counters", "flags", "skipped", "good"):
        setattr(progress, name, wp.zeros(2, dtype=int, device=device))
    progress.scale = wp.full(2, scale, dtype=float, device=device)
    progress.losses = wp.zeros(HISTORY, dtype=float, device=device)
    progress.batch = wp.array(sizes, dtype=int, device=device)
    progress.rates, progress.seed = optimizer.rates, seed
    return progress


def make_update(optimizer: Adam | SGD, n: int, batches: int, average: float | None, dynamic: bool) -> Update:
    """Of n parameters, averaged if `average` is a decay; dynamic: the scale of gradients adapts."""
    options = Update()
    options.settings, options.dynamic, options.batches = optimizer.settings, dynamic, batches
    options.first, options.second = optimizer.first, optimizer.second
    options.average = wp.zeros(0 if average is None else n, dtype=float, device=optimizer.first.device)
    options.decay = average or 0.0
    return options
