"""Which weight of the rate leads to a wanted size or quality: short runs, a secant, and corrections on the way.

Goals are numbers that fall or rise smoothly with log(lambda): log(bits a texel), with a slope of -0.9 to -0.5, and
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


@dataclass(frozen=True)
class Goal:
    """value: wanted of `measure(trainer, finished)`. slope: of it by log(lambda), a first guess. tolerance: met within
    it."""

    measure: Callable[[TextureTrainer, bool], float]
    value: float
    slope: float
    tolerance: float


@dataclass(frozen=True)
class Probe:
    """A run and what it led to: goal measured at its end, and at each of `LOOKS` less that at the end."""

    rate_weight: float
    result: float
    ahead: tuple[float, ...]


def run_with_looks(trainer: TextureTrainer, goal: Goal, look: Callable[[int, float], None], **options) -> Probe:
    """All steps; `look(k, measured)` at the k-th of `LOOKS`."""
    seen = []
    for k, fraction in enumerate(LOOKS):
        trainer.run(int(fraction * trainer.schedule.noise_until), **options)
        seen.append(goal.measure(trainer, False))
        look(k, seen[-1])
    trainer.run(**options)
    result = goal.measure(trainer, True)
    return Probe(trainer.rate_weight, result, tuple(measured - result for measured in seen))


def find(
    make_short: Callable[[float], TextureTrainer], start: float, goal: Goal, probes: int = 2, **options
) -> tuple[Probe, float, float]:
    """The last of some short runs, of which the first has weight `start`; the weight for the long run, the slope."""
    done, weight, slope = [], start, goal.slope
    for _ in range(probes):
        done.append(run_with_looks(make_short(weight), goal, lambda k, measured: None, **options))
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
    return probe.rate_weight * exp(max(-LARGEST_CHANGE, min(change, LARGEST_CHANGE)))


def meet(trainer: TextureTrainer, goal: Goal, last: Probe, slope: float, tries: int = 4, **options) -> Probe:
    """The long run, corrected on its way; from its last look on again until the goal is met. last: the probe before."""
    saved = {}

    def look(k: int, measured: float) -> None:
        expected = Probe(trainer.rate_weight, measured - last.ahead[k], ())
        trainer.rate_weight = next_weight(expected, goal, slope)
        if k == len(LOOKS) - 1:
            saved.update(trainer.snapshot())

    done = [run_with_looks(trainer, goal, look, **options)]
    late = 0.6 * slope  # what is left of the run does less
    while abs(done[-1].result - goal.value) > goal.tolerance and len(done) <= tries:
        trainer.rate_weight = next_weight(done[-1], goal, late)
        trainer.restore(saved)
        trainer.run(**options)
        done.append(Probe(trainer.rate_weight, goal.measure(trainer, True), done[0].ahead))
        late = slope_of(done, late)
    return done[-1]
