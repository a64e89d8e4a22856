"""Losses and their derivatives in the prediction, in float64 NumPy."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from reference_networks import sigmoid

from warp_neural.kernels.nn.losses import Loss


class Term(NamedTuple):
    """Of one component, by prediction p and target t. frozen: the denominator, constant in the derivative, of p."""

    value: Callable
    slope: Callable
    frozen: Callable = lambda p, t: 1.0


def magnitude(d):
    return d * np.sign(np.real(d))  # np.abs, and for complex numbers what continues it


def square(p, t):
    return (p - t) ** 2


def absolute(p, t):
    return magnitude(p - t)


def sign(p, t):
    return np.sign(p - t)


def root(x):
    return np.where(x > 0, x, 0) ** (1 / 2.2)


def huber(delta):
    def value(p, t):
        d = magnitude(p - t)
        return np.where(d <= delta, d**2 / 2, delta * (d - delta / 2))

    return Term(value, lambda p, t: np.clip(p - t, -delta, delta))


def gamma_slope(p, t):
    positive = np.where(p > 0, p, 1)
    return np.where(p > 0, 2 / 2.2 * (root(p) - root(t)) * positive ** (1 / 2.2 - 1), 0)


TERMS = {
    "l1": Term(absolute, sign),
    "l2": Term(square, lambda p, t: 2 * (p - t)),
    "relative_l1": Term(absolute, sign, lambda p, t: np.abs(p) + 0.01),
    "relative_l2": Term(square, lambda p, t: 2 * (p - t), lambda p, t: p**2 + 0.01),
    "mape": Term(absolute, sign, lambda p, t: np.abs(t) + 0.01),
    "smape": Term(absolute, sign, lambda p, t: (np.abs(p) + np.abs(t)) / 2 + 0.01),
    "huber(1.0)": huber(1.0),
    "huber(0.25)": huber(0.25),
    "gamma_l2": Term(lambda p, t: (root(p) - root(t)) ** 2, gamma_slope),
}


def weights_of(loss: Loss, n: int) -> np.ndarray:
    return np.array(loss.weights or [1.0] * n)


def value(loss: Loss, p, t, constant=None):
    """`[rows]` of predictions and targets `[rows, n]`; constant: predictions that the denominators see."""
    w = weights_of(loss, p.shape[1])
    if loss.name != "cross_entropy":
        term = TERMS[loss.name]
        return (w * term.value(p, t) / term.frozen(p if constant is None else constant, t)).mean(axis=1)
    if p.shape[1] == 1:
        return (w * (np.log1p(np.exp(p)) - t * p)).sum(axis=1)
    return -(w * t * (p - np.log(np.exp(p).sum(axis=1, keepdims=True)))).sum(axis=1)


def gradient(loss: Loss, p, t):
    """`[rows, n]`."""
    w = weights_of(loss, p.shape[1])
    if loss.name != "cross_entropy":
        term = TERMS[loss.name]
        return w * term.slope(p, t) / term.frozen(p, t) / p.shape[1]
    if p.shape[1] == 1:
        return w * (sigmoid(p) - t)
    softmax = np.exp(p) / np.exp(p).sum(axis=1, keepdims=True)
    return (w * t).sum(axis=1, keepdims=True) * softmax - w * t
