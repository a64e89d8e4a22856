"""The truth in float64 NumPy, written for clarity: shader, rendering, finite differences, optimizers, networks."""

import math

import ml_dtypes
import numpy as np


def dot(a, b):
    return np.sum(a * b, axis=-1)


def normalize(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def brdf(albedo, normal, roughness, metalness, specular, light, view):
    """The course's shader as course.md states it; arrays broadcast, vectors in the last axis."""
    nl, nv = dot(normal, light), dot(normal, view)
    half = normalize(light + view)
    nh, lh = dot(normal, half), dot(light, half)
    alpha = np.maximum(roughness**2, 1e-3)

    def schlick(u):
        return (1 - np.clip(u, 0, 1)) ** 5

    def smith(c):
        return 1 / (c + np.sqrt(alpha**2 + c**2 - alpha**2 * c**2))

    with np.errstate(invalid="ignore", divide="ignore"):
        fd90 = 0.5 + 2 * lh**2 * roughness
        diffuse = (1 + (fd90 - 1) * schlick(nl)) * (1 + (fd90 - 1) * schlick(nv)) / np.pi * (1 - metalness)
        d = alpha**2 / (np.pi * (1 + (alpha**2 - 1) * nh**2) ** 2)
        c0 = (0.08 * specular * (1 - metalness))[..., None] + albedo * metalness[..., None]
        fresnel = c0 + (1 - c0) * schlick(lh)[..., None]
        color = (albedo * diffuse[..., None] + fresnel * (d * smith(nl) * smith(nv))[..., None]) * nl[..., None] * 1.5
    return np.where(((nl > 0) & (nv > 0))[..., None], color, 0.0)


def display(color, offset=0.0):
    x = np.abs(color)
    film = np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0)
    return (film + offset) ** (1 / 2.2)


def texel_loss(albedo, normal, roughness, metalness, specular, light, view, reference, weights):
    color = brdf(albedo, normalize(normal), roughness, metalness, specular, light, view)
    squares = weights[0] * (color - reference) ** 2
    squares += weights[1] * (display(color, 1e-4) - display(reference, 1e-4)) ** 2
    return squares.mean(axis=-1)


def blocks(image, factor):
    """`[height, width, ...]` to `[texels, factor^2, ...]`: what lies under each texel of a mip level."""
    height, width = image.shape[0] // factor, image.shape[1] // factor
    split = image.reshape(height, factor, width, factor, *image.shape[2:])
    return np.moveaxis(split, 2, 1).reshape(height * width, factor * factor, *image.shape[2:])


def render_mean(maps, factor, light, view):
    """Radiance `[texels, 3]` of a dict of maps: shade in full resolution, then average."""
    parts = {name: blocks(image.astype(np.float64), factor) for name, image in maps.items()}
    return brdf(*parts.values(), light, view).mean(axis=1)


def finite_difference(function, values, step=1e-6):
    """Central differences of `function(values)` (one value per row) for each column of `values` `[rows, columns]`."""
    gradient = np.empty_like(values)
    for column in range(values.shape[1]):
        shift = np.zeros(values.shape[1])
        shift[column] = step
        gradient[:, column] = (function(values + shift) - function(values - shift)) / (2 * step)
    return gradient


def adam(parameters, gradients, rates, beta1=0.9, beta2=0.999, eps=1e-8, weight_decay=0.0):
    """AdamW over a list of gradients, one a step; returns the parameters after the last."""
    p = parameters.astype(np.float64)
    m = v = np.zeros_like(p)
    for step, (g, rate) in enumerate(zip(gradients, rates, strict=True), start=1):
        m = beta1 * m + (1 - beta1) * g
        v = beta2 * v + (1 - beta2) * g**2
        p = p - rate * (m / (1 - beta1**step) / (np.sqrt(v / (1 - beta2**step)) + eps) + weight_decay * p)
    return p


def sgd(parameters, gradients, rates, momentum=0.0, weight_decay=0.0):
    p = parameters.astype(np.float64)
    velocity = np.zeros_like(p)
    for g, rate in zip(gradients, rates, strict=True):
        velocity = momentum * velocity + g + weight_decay * p
        p = p - rate * velocity
    return p


def sigmoid(z):
    return 1 / (1 + np.exp(-z))


ACTIVATIONS = {
    "linear": lambda z: z,
    "relu": lambda z: np.maximum(z, 0),
    "leaky_relu": lambda z: np.where(z > 0, z, 0.01 * z),
    "exponential": np.exp,
    "shifted_exponential": lambda z: np.exp(z - 3),
    "sigmoid": sigmoid,
    "tanh": np.tanh,
    "silu": lambda z: z * sigmoid(z),
    "gelu": lambda z: 0.5 * z * (1 + np.vectorize(math.erf)(z / math.sqrt(2))),
    "softplus": lambda z: np.logaddexp(0, z),
    "sine": np.sin,
    "squareplus": lambda z: 0.5 * (z + np.sqrt(z * z + 4)),
}


def slope(f, z, step=1e-6):
    return (f(z + step) - f(z - step)) / (2 * step)


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
        dz = dy * slope(f, z)
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
        return np.rint(np.clip(x, -127, 127))
    if format in ("e4m3", "e5m2"):
        largest = np.float32(ml_dtypes.finfo(FORMATS[format]).max)
        x = np.clip(x, -largest, largest)
    return x.astype(FORMATS[format]).astype(np.float32)


def mlp_rounded(weights, biases, activations, x, format, accumulation="float32", steps=None):
    """The network as tensor cores compute it: rounded weights and vectors, sums in float32 in the order of the inputs.

    With float16 accumulation, sums are rounded after each block of 16 (float16) or 32 products (8 bits). steps
    `[layers, 2]`: of the inputs and of the weights, for int8.
    """
    half = accumulation == "float16"
    block = 32 if format in ("e4m3", "e5m2") else 16
    h = np.asarray(x, np.float32)
    for layer, (w, b, f) in enumerate(zip(weights, biases, activations, strict=True)):
        step_in, step = np.float32(steps[layer]) if format == "int8" else np.ones(2, np.float32)
        h, w = rounded(h * (1 / step_in), format), rounded(w / step, format)
        total = np.tile(np.float32(0 if format == "int8" else b), (len(h), 1)) * np.ones(len(b), np.float32)
        total = rounded(total, "float16") if half else total
        for k in range(len(w.T)):  # one fused multiply-add: exact product, one rounding
            total = (h[:, k, None].astype(np.float64) * w[:, k] + total).astype(np.float32)
            if half and (k % block == block - 1 or k == len(w.T) - 1):
                total = rounded(total, "float16")
        if format == "int8":
            total = (total.astype(np.float64) * (step_in * step) + b).astype(np.float32)
        h = f(total).astype(np.float32)
    return rounded(h, "float16") if half else h
