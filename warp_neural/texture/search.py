"""Which weight of the rate leads to a wanted size or quality: short runs, a secant, and corrections on the way.

Goals are numbers that fall or rise smoothly with log(lambda): log(bits of latents), with a slope of -0.9 to -0.5, and
PSNR, of about -2 dB. A short run misses the long one's by some percent, which the long run corrects: its schedule is
that of the short one, stretched, so that what is still to come at a fraction of the run is known from it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, log

from warp_neural.texture.trainer import TextureTrainer

LOOKS = (
    0.5,
    0.65,
    0.78,
    0.86,
)  # of the noisy steps, where the long run is corrected; the last is where it may begin again
LARGEST_CHANGE = 1.5  # of log(lambda) at once
LEAST, MOST = 1e-8, 0.1  # lambda: beyond, nothing changes


@dataclass(frozen=True)
class Goal:
    """value: wanted of `measure(trainer)` after a run. estimate: about the same, free, at any time. slope: of it by
    log(lambda), a first guess. tolerance: met within it."""

    estimate: Callable[[TextureTrainer], float]
    measure: Callable[[TextureTrainer], float]
    value: float
    slope: float
    tolerance: float


@dataclass(frozen=True)
class Probe:
    """A run and what it led to: the goal's number at its end, and that at each of `LOOKS` less the one at the end."""

    rate_weight: float
    result: float
    ahead: tuple[float, ...]


def short_run(trainer: TextureTrainer, goal: Goal, **options) -> Probe:
    seen = []
    for fraction in LOOKS:
        trainer.run(int(fraction * trainer.schedule.noise_until), **options)
        seen.append(goal.estimate(trainer))
    trainer.run(**options)
    result = goal.estimate(trainer)
    return Probe(trainer.rate_weight, result, tuple(estimate - result for estimate in seen))


def find(
    make_short: Callable[[float], TextureTrainer], start: float, goal: Goal, probes: int = 2, **options
) -> tuple[Probe, float, float]:
    """The last of some short runs, of which the first has weight `start`; the weight for the long run, the slope."""
    done, weight, slope = [], start, goal.slope
    for _ in range(probes):
        done.append(short_run(make_short(weight), goal, **options))
        slope = slope_of(done, slope)
        weight = next_weight(done[-1], goal, slope)
    return done[-1], weight, slope


def slope_of(done: list[Probe], before: float) -> float:
    """Between the last two probes; one far from what is usual is not trusted."""
    if len(done) < 2 or abs(log(done[-1].rate_weight / done[-2].rate_weight)) < 0.05:
        return before
    found = (done[-1].result - done[-2].result) / log(done[-1].rate_weight / done[-2].rate_weight)
    return found if 0.4 < found / before < 2.5 else before


def next_weight(probe: Probe, goal: Goal, slope: float) -> float:
    """With which the next run should meet the goal."""
    change = (goal.value - probe.result) / slope
    weight = probe.rate_weight * exp(max(-LARGEST_CHANGE, min(change, LARGEST_CHANGE)))
    return max(LEAST, min(weight, MOST))


def meet(trainer: TextureTrainer, goal: Goal, last: Probe, slope: float, tries: int = 4, **options) -> Probe:
    """The long run, corrected on its way; from its last look on again until the goal is met. last: the probe before."""
    saved = {}
    for fraction, ahead in zip(LOOKS, last.ahead, strict=True):
        at = int(fraction * trainer.schedule.noise_until)
        if trainer.index < at:  # a run that goes on from a checkpoint may be past it
            trainer.run(at, **options)
            expected = Probe(trainer.rate_weight, goal.estimate(trainer) - ahead, ())
            trainer.rate_weight = next_weight(expected, goal, slope)
            saved = trainer.snapshot()
    trainer.run(**options)
    done = [Probe(trainer.rate_weight, goal.measure(trainer), last.ahead)]
    late = 0.6 * slope  # what is left of the run does less
    while saved and abs(done[-1].result - goal.value) > goal.tolerance and len(done) <= tries:
        trainer.rate_weight = next_weight(done[-1], goal, late)
        trainer.restore(saved)
        trainer.run(**options)
        done.append(Probe(trainer.rate_weight, goal.measure(trainer), last.ahead))
        late = slope_of(done, late)
    return done[-1]
