"""Optimizer steps in float64 NumPy, where parameters of an encoding that have no gradient rest."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Run:
    """values [n] and the moments of a run; those from `sparse` on belong to an encoding."""

    values: np.ndarray
    sparse: int

    def __post_init__(self):
        self.values = self.values.astype(np.float64)
        self.first, self.second, self.average = (np.zeros_like(self.values) for _ in range(3))
        self.t = 0

    def moving(self, g: np.ndarray) -> np.ndarray:
        return (g != 0) | (np.arange(len(g)) < self.sparse)

    def adam(self, g, rate, beta1=0.9, beta2=0.999, eps=1e-8, decay=0.0):
        """Kingma and Ba 2015, algorithm 1, with the weight decay of AdamW."""
        self.t += 1
        m, v = beta1 * self.first + (1 - beta1) * g, beta2 * self.second + (1 - beta2) * g**2
        change = m / (1 - beta1**self.t) / (np.sqrt(v / (1 - beta2**self.t)) + eps)
        self.set(self.moving(g), self.values - rate * (change + decay * self.values), m, v)

    def sgd(self, g, rate, momentum):
        self.t += 1
        velocity = momentum * self.first + g
        self.set(self.moving(g), self.values - rate * velocity, velocity, velocity)

    def set(self, moving, *new):
        old = self.values, self.first, self.second
        self.values, self.first, self.second = (np.where(moving, n, o) for n, o in zip(new, old, strict=True))
        self.average += (self.values - self.average) / self.t  # exponential only after the first 1 / (1 - decay) steps
