"""When latents are noisy, rounded and at rest, and the rates of the optimizer in each step."""

from dataclasses import dataclass

import numpy as np

NOISE, ROUNDING = 0.90, 0.93  # of the steps: noise until here, rounded latents until here, then the network alone
END_OF_NOISE = 0.015  # of the rates at the start; 0.08 costs 0.3 dB at equal bits, no rounded steps 0.1 to 0.6
RAMP = 0.1  # of the steps, in which the weight of the rate grows


@dataclass(frozen=True)
class Schedule:
    """steps: of the run. latents, network: factors of their rates, [steps]. rate: of the weight of the rate."""

    steps: int
    noise_until: int
    latents_until: int
    latents: np.ndarray
    network: np.ndarray
    rate: np.ndarray


def make_schedule(steps: int) -> Schedule:
    first, second = int(NOISE * steps), int(ROUNDING * steps)
    t = np.arange(steps)
    falling = END_OF_NOISE + (1 - END_OF_NOISE) * half_cosine(t / max(first, 1))
    rounded, alone = (t - first) / max(second - first, 1), (t - second) / max(steps - second, 1)
    latents = np.where(t < first, falling, np.where(t < second, END_OF_NOISE * half_cosine(rounded), 0.0))
    tuned = 0.02 + (END_OF_NOISE - 0.02) * half_cosine(rounded)
    network = np.where(t < first, falling, np.where(t < second, tuned, 0.1 * half_cosine(alone)))
    return Schedule(steps, first, second, latents, network, np.clip(t / max(RAMP * steps, 1), 0.02, 1))


def half_cosine(x: np.ndarray) -> np.ndarray:
    """1 at 0 to 0 at 1."""
    return 0.5 * (1 + np.cos(np.pi * np.clip(x, 0, 1)))
