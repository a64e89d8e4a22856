"""Random numbers of threads, without a state: Philox4x32-10, by integer arithmetic, the same on CPU and CUDA.

    u = wn.random.uniform(random, 0)  # four numbers in [0, 1): u[0] to u[3]
    v = wn.random.uniform(random, 1)  # the next four

A seed's streams are the parts of one bijection of 128-bit counters (purpose, step, index, block), so that no two blocks
of four are the same one; seeds are the keys of different bijections. A block is a function of its number: in loops, and
when a backward pass runs forward code again, it stays what it was, which `wp.randf` does not promise.
Salmon et al., Parallel Random Numbers: As Easy as 1, 2, 3, 2011.
"""

import warp as wp

TRAINING = wp.constant(0)
HELD_OUT = wp.constant(1)

MULTIPLIER_0, MULTIPLIER_1 = wp.constant(wp.uint64(0xD2511F53)), wp.constant(wp.uint64(0xCD9E8D57))
WEYL_0, WEYL_1 = wp.constant(wp.uint32(0x9E3779B9)), wp.constant(wp.uint32(0xBB67AE85))
HALF = wp.constant(wp.uint64(32))
TO_UNIT = wp.constant(2.0**-24)


@wp.struct
class Stream:
    """The random numbers of one thread of one launch: draw with `uniform`."""

    seed: wp.uint64
    index: wp.uint32
    step: wp.uint32
    purpose: wp.uint32


@wp.func
def stream(seed: wp.uint64, step: int, index: int, purpose: int = 0) -> Stream:
    """Of thread `index` of launch `step`. purpose: TRAINING, HELD_OUT, or a number of one's own."""
    random = Stream()
    random.seed = seed
    random.index = wp.uint32(index)
    random.step = wp.uint32(step)
    random.purpose = wp.uint32(purpose)
    return random


@wp.func
def philox(c0: wp.uint32, c1: wp.uint32, c2: wp.uint32, c3: wp.uint32, k0: wp.uint32, k1: wp.uint32):
    """Ten rounds, of counter and key."""
    for _ in range(10):
        p0, p1 = wp.uint64(c0) * MULTIPLIER_0, wp.uint64(c2) * MULTIPLIER_1
        c0, c2 = wp.uint32(p1 >> HALF) ^ c1 ^ k0, wp.uint32(p0 >> HALF) ^ c3 ^ k1
        c1, c3 = wp.uint32(p1), wp.uint32(p0)
        k0, k1 = k0 + WEYL_0, k1 + WEYL_1
    return c0, c1, c2, c3


@wp.func
def unit(bits: wp.uint32) -> float:
    return float(bits >> wp.uint32(8)) * TO_UNIT


@wp.func
def uniform(random: Stream, block: int) -> wp.vec4:
    """Four independent numbers in [0, 1), in steps of 2^-24: block 0, 1, 2 and so on of the stream."""
    key = random.seed
    a, b, c, d = philox(
        wp.uint32(block), random.index, random.step, random.purpose, wp.uint32(key), wp.uint32(key >> HALF)
    )
    return wp.vec4(unit(a), unit(b), unit(c), unit(d))
