"""The truth about networks in float64 NumPy: activations, forward and backward, rounding to each number format."""

from collections.abc import Callable
from typing import NamedTuple

import ml_dtypes
import numpy as np
from scipy.special import erf


class Activation(NamedTuple):
    value: Callable
    slope: Callable

    def __call__(self, z):
        return self.value(z)


def sigmoid(z):
    return 1 / (1 + np.exp(-z))


def normal_cdf(z):
    return (1 + erf(z / np.sqrt(2))) / 2


ACTIVATIONS = {
    "linear": Activation(lambda z: z, np.ones_like),
    "relu": Activation(lambda z: np.maximum(z, 0), lambda z: np.where(z > 0, 1, 0)),
    "leaky_relu": Activation(lambda z: np.where(z > 0, z, 0.01 * z), lambda z: np.where(z > 0, 1, 0.01)),
    "elu": Activation(lambda z: np.where(z > 0, z, np.expm1(z)), lambda z: np.where(z > 0, 1, np.exp(z))),
    "exponential": Activation(np.exp, np.exp),
    "shifted_exponential": Activation(lambda z: np.exp(z - 3), lambda z: np.exp(z - 3)),
    "sigmoid": Activation(sigmoid, lambda z: sigmoid(z) * sigmoid(-z)),
    "tanh": Activation(np.tanh, lambda z: 1 / np.cosh(z) ** 2),
    "silu": Activation(lambda z: z * sigmoid(z), lambda z: sigmoid(z) + z * sigmoid(z) * sigmoid(-z)),
    "gelu": Activation(
        lambda z: z * normal_cdf(z), lambda z: normal_cdf(z) + z * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
    ),
    "softplus": Activation(lambda z: np.log1p(np.exp(z)), sigmoid),
    "sine": Activation(np.sin, np.cos),
    "squareplus": Activation(lambda z: (z + np.sqrt(z**2 + 4)) / 2, lambda z: (1 + z / np.sqrt(z**2 + 4)) / 2),
}


def mlp(weights, biases, activations, x, dy=None):
    """Network results `[n, n_out]` of `x` `[n, n_in]`; with `dy`, also gradients of weights, of biases, and of `x`."""
    h, kept = np.asarray(x, np.float64), []
    for w, b, f in zip(weights, biases, activations, strict=True):
        z = h @ w.T + b
        kept.append((h, z))
        h = f(z)
    if dy is None:
        return h
    dw, db = [], []
    for w, f, (x, z) in reversed(list(zip(weights, activations, kept, strict=True))):
        dz = dy * f.slope(z)
        dw.insert(0, dz.T @ x)
        db.insert(0, dz.sum(axis=0))
        dy = dz @ w
    return h, dw, db, dy


FORMATS = {
    "float16": np.float16,
    "bfloat16": ml_dtypes.bfloat16,
    "e4m3": ml_dtypes.float8_e4m3fn,
    "e5m2": ml_dtypes.float8_e5m2,
}


def rounded(x, format):
    """`x` rounded to a format and back to float32; 8-bit formats saturate, int8 rounds to whole numbers."""
    x = np.asarray(x, np.float32)
    if format == "float32":
        return x
    if format == "tf32":  # cvt.rna: ties away from zero
        return ((x.view(np.uint32) + 0x1000) & 0xFFFFE000).view(np.float32)
    if format == "int8":
        return np.rint(np.clip(x, -128, 127))
    if format in ("e4m3", "e5m2"):
        largest = np.float32(ml_dtypes.finfo(FORMATS[format]).max)
        x = np.clip(x, -largest, largest)
    return x.astype(FORMATS[format]).astype(np.float32)


MAGIC = np.float32(1.5 * 2**23)


def mlp_rounded(weights, biases, activations, x, format, accumulation="float32", steps=None):
    """The ReLU network as tensor cores compute it: rounded weights and vectors, float32 sums in order of the inputs.

    With float16 accumulation, sums are rounded after each block of 16 (float16) or 32 products (8 bits). steps
    `[layers, 2]`: of the inputs and of the weights, for int8.
    """
    half = accumulation == "float16"
    block = 32 if format in ("e4m3", "e5m2") else 16
    h, shares = np.asarray(x, np.float32), False
    for layer, (w, b, f) in enumerate(zip(weights, biases, activations, strict=True)):
        step_in, step = np.float32(steps[layer]) if format == "int8" else np.ones(2, np.float32)
        h, w = rounded(h * (127 if shares else 1 / step_in), format), rounded(w / step, format)
        late = half and format == "float16" and layer < len(weights) - 1  # the bias is added at the end
        total = np.tile(np.float32(0 if format == "int8" or late else b), (len(h), 1)) * np.ones(len(b), np.float32)
        total = rounded(total, "float16") if half else total
        for k in range(len(w.T)):  # one fused multiply-add: exact product, one rounding
            total = (h[:, k, None].astype(np.float64) * w[:, k] + total).astype(np.float32)
            if half and (k % block == block - 1 or k == len(w.T) - 1):
                total = rounded(total, "float16")
        if late:
            total = rounded(total + rounded(b, "float16"), "float16")
        shares = format == "int8" and layer < len(weights) - 1
        if shares:  # of the next layer's largest input, for ReLU; the bias is rounded on the way
            largest = 1 / (np.float32(127) * np.float32(steps[layer + 1][0]))
            share = ((step_in * step * largest).view(np.uint32) & 0xFFFFFFFC).view(np.float32)
            b = (np.float32(b) * largest - MAGIC * share).astype(np.float64)
            total = ((total + MAGIC).astype(np.float64) * share + b).astype(np.float32)
            total = np.minimum(total, 1)
        elif format == "int8":
            total = (total.astype(np.float64) * (step_in * step) + b).astype(np.float32)
        h = f(total).astype(np.float32)
    return rounded(h, "float16") if half else h
