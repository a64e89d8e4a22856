"""Which weight of the rate leads to a wanted size or quality: it is steered while a run goes on.

Goals are numbers that fall with log(lambda): log(bits of latents), with a slope of -0.9 to -0.3, and PSNR, of about -2
dB. In a run both go on changing, as the rates of the optimizer fall, by about as much for any picture; so what a run
will end with is known from a quarter of it on, and lambda is moved as long as latents can follow.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np

from warp_neural.texture.trainer import TextureTrainer

MOMENTS = 0.15, 0.25, 0.35, 0.45, 0.55, 0.65  # of a run's steps, when lambda is changed
AGAIN_FROM = 0.45, 0.65  # for large and for small changes
SMALL = 0.15  # change of log(lambda); larger ones from 0.65 on cost up to 1 dB (Metal053C, 3.9 bits)
LARGEST = 1.5  # change of log(lambda) at once
LEAST, MOST = 1e-8, 0.1  # lambda: beyond, nothing changes


@dataclass(frozen=True)
class Goal:
    """value: wanted of `measure(trainer)` at the end of a run. slope: of it by log(lambda), about. tolerance: met
    within it. to_come: by how much it will still grow from each of `MOMENTS` on."""

    measure: Callable[[TextureTrainer], float]
    value: float
    slope: float
    tolerance: float
    to_come: Sequence[float]

    def met(self, result: float) -> bool:
        return abs(result - self.value) <= self.tolerance


@dataclass(frozen=True)
class Trial:
    """A run's weight in the end, and what it led to."""

    rate_weight: float
    result: float


Snapshots = list[dict[str, np.ndarray]]


def meet(trainer: TextureTrainer, goal: Goal, first: Snapshots, tries: int = 6, **options) -> bool:
    """Run to the end, and its last part again until the goal is met: whether it is. first: where the run began, if it
    has gone on from a checkpoint."""
    snapshots = first + _steer(trainer, goal, **options)
    steered, slope, again_from = trainer.rate_weight, goal.slope, -1
    trials = [_end(trainer, goal, **options)]
    for _ in range(tries - 1):
        if goal.met(trials[-1].result):
            break
        slope = slope_of(trials, slope)
        weight = next_weight(trials, goal, slope)
        if again_from and abs(log(weight / steered)) > SMALL:
            trials, again_from = [], 0  # runs from there follow another curve
        trainer.restore(snapshots[again_from])
        trainer.rate_weight = weight
        trials.append(_end(trainer, goal, **options))
    return goal.met(trials[-1].result)


def _end(trainer: TextureTrainer, goal: Goal, **options) -> Trial:
    trainer.run(**options)
    return Trial(trainer.rate_weight, goal.measure(trainer))


def _steer(trainer: TextureTrainer, goal: Goal, **options) -> Snapshots:
    """Up to the last moment; those of `AGAIN_FROM` that were passed."""
    snapshots = []
    for share, to_come in zip(MOMENTS, goal.to_come, strict=True):
        moment = int(share * trainer.steps)
        if trainer.index > moment:
            continue
        trainer.run(moment, **options)
        expected = Trial(trainer.rate_weight, goal.measure(trainer) + to_come)
        trainer.rate_weight = next_weight([expected], goal, goal.slope)
        if share in AGAIN_FROM:
            snapshots.append(trainer.snapshot())
    return snapshots


def slope_of(trials: list[Trial], before: float) -> float:
    """Between the last two; one far from what is usual is not trusted."""
    if len(trials) < 2 or abs(log(trials[-1].rate_weight / trials[-2].rate_weight)) < 0.02:
        return before
    found = (trials[-1].result - trials[-2].result) / log(trials[-1].rate_weight / trials[-2].rate_weight)
    return found if 0.3 < found / before < 3 else before


def next_weight(trials: list[Trial], goal: Goal, slope: float) -> float:
    """With which the next run should meet the goal: between the nearest runs on both sides of it, if there are."""
    nearest = sorted(trials, key=lambda trial: abs(trial.result - goal.value))
    over, under = ([t for t in nearest if (t.result > goal.value) == side] for side in (True, False))
    if over and under:
        share = (goal.value - under[0].result) / (over[0].result - under[0].result)
        return under[0].rate_weight ** (1 - share) * over[0].rate_weight ** share
    change = (goal.value - nearest[0].result) / slope
    weight = nearest[0].rate_weight * exp(max(-LARGEST, min(change, LARGEST)))
    return max(LEAST, min(weight, MOST))
