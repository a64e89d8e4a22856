"""Random numbers of threads: integer arithmetic (PCG), so that CPU and CUDA draw the same ones."""

import warp as wp


@wp.func
def random_stream(seed: int, step: int, index: int) -> wp.uint32:
    """The state of a generator for one thread (`index`) of one launch (`step`); draw with `wp.randf`."""
    return wp.rand_init(int(wp.rand_init(seed, step)), index)
