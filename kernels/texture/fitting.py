"""The kernel that fits the context of a grid's latents to samples of them."""

from functools import cache
from pathlib import Path

import warp as wp

from warp_neural.kernels.native import paste

LANES, VECTORS = 8, 4  # samples side by side: cells are a multiple of both
LEAST = 2.0**-20  # of a probability: what the tables do not have
WEIGHT_BITS = 8.0  # of a weight in the file, about
MOST = 14 + 3 * 32  # weights of a channel

_CONSTANTS = {"LANES": LANES, "VECTORS": VECTORS, "LEAST": LEAST, "WEIGHT_BITS": WEIGHT_BITS, "MOST": MOST}


@cache
def fit_kernel() -> wp.Kernel:
    """Thread c trains the weights of channel c, the CPU's alone. values: in, where each begins, out, the weights."""

    @wp.func_native(paste(Path(__file__).parent / "native" / "fit_channel.h", **_CONSTANTS))
    def fit_channel(
        samples: wp.array2d[wp.int16], values: wp.array2d[float], channel: int, steps: int, batch: int,
        stands_for: float,
    ): ...  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False)
    def fit(samples: wp.array2d[wp.int16], values: wp.array2d[float], steps: int, batch: int, stands_for: float):
        fit_channel(samples, values, wp.tid(), steps, batch, stands_for)

    return fit
