"""Which weight of the rate leads to a wanted size or quality: short runs and a secant, then the long run.

Goals are numbers that fall or rise smoothly with log(lambda): log(bits of latents), with a slope of -0.9 to -0.3, and
PSNR, of about -2 dB. Short runs of an eighth of the steps end with 1.2 to 3 times the long one's bits, by material, so
the long run is taken again, from where its rates are still high, until the goal is met.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, log

from warp_neural.texture.trainer import TextureTrainer

AGAIN_FROM = 0.4  # of the noisy steps; from 0.65 a large change of lambda cost 1 dB (Metal053C, 3.9 bits)
LARGEST_CHANGE = 1.5  # of log(lambda) at once
LEAST, MOST = 1e-8, 0.1  # lambda: beyond, nothing changes


@dataclass(frozen=True)
class Goal:
    """value: wanted of `measure(trainer)` after the long run. estimate: about the same, after short ones. slope:
    of it by log(lambda), a first guess. tolerance: met within it."""

    estimate: Callable[[TextureTrainer], float]
    measure: Callable[[TextureTrainer], float]
    value: float
    slope: float
    tolerance: float

    def met(self, result: float) -> bool:
        return abs(result - self.value) <= self.tolerance


@dataclass(frozen=True)
class Probe:
    """A run's weight and what it led to."""

    rate_weight: float
    result: float


def find(
    make_short: Callable[[float], TextureTrainer], start: float, goal: Goal, probes: int, **options
) -> tuple[float, float]:
    """The weight for the long run and the slope there, from at most `probes` short runs, of which the first has weight
    `start`."""
    done, weight, slope = [], start, goal.slope
    while len(done) < probes and not (done and goal.met(done[-1].result)):
        trainer = make_short(weight)
        trainer.run(**options)
        done.append(Probe(weight, goal.estimate(trainer)))
        slope = slope_of(done, slope)
        weight = next_weight(done, goal, slope)
    return weight, slope


def slope_of(done: list[Probe], before: float) -> float:
    """Between the last two probes; one far from what is usual is not trusted."""
    if len(done) < 2 or abs(log(done[-1].rate_weight / done[-2].rate_weight)) < 0.02:
        return before
    found = (done[-1].result - done[-2].result) / log(done[-1].rate_weight / done[-2].rate_weight)
    return found if 0.3 < found / before < 3 else before


def next_weight(done: list[Probe], goal: Goal, slope: float) -> float:
    """With which the next run should meet the goal: between the nearest runs on both sides of it, if there are."""
    nearest = sorted(done, key=lambda probe: abs(probe.result - goal.value))
    over, under = ([p for p in nearest if (p.result > goal.value) == side] for side in (True, False))
    if over and under:
        share = (goal.value - under[0].result) / (over[0].result - under[0].result)
        return under[0].rate_weight ** (1 - share) * over[0].rate_weight ** share
    change = (goal.value - nearest[0].result) / slope
    weight = nearest[0].rate_weight * exp(max(-LARGEST_CHANGE, min(change, LARGEST_CHANGE)))
    return max(LEAST, min(weight, MOST))


def meet(trainer: TextureTrainer, goal: Goal, slope: float, tries: int = 5, **options) -> float:
    """The long run, from `AGAIN_FROM` on again until the goal is met. What it led to."""
    again_from, saved = int(AGAIN_FROM * trainer.schedule.noise_until), None
    if trainer.index <= again_from:  # a run that goes on from a checkpoint may be past it
        trainer.run(again_from, **options)
        saved = trainer.snapshot()
    trainer.run(**options)
    done = [Probe(trainer.rate_weight, goal.measure(trainer))]
    while saved and not goal.met(done[-1].result) and len(done) < tries:
        weight = next_weight(done, goal, slope)
        trainer.restore(saved)
        trainer.rate_weight = weight
        trainer.run(**options)
        done.append(Probe(weight, goal.measure(trainer)))
        slope = slope_of(done, slope)
    return done[-1].result
