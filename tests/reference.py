"""The truth in float64 NumPy, written for clarity: shader, display, rendering, derivatives, optimizers."""

import numpy as np


def dot(a, b):
    return np.sum(a * b, axis=-1)


def normalize(v):
    return v / np.sqrt(dot(v, v))[..., None]


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


def display(x, offset=0.0):
    """Of a colour x that is nowhere negative."""
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


def derivative(function, values, step=1e-30):
    """Of `function(values)` (one value per row) by each column of `values` `[rows, columns]`.

    By a step into the complex plane, which loses no digits to cancellation: Squire and Trapp 1998, "Using Complex
    Variables to Estimate Derivatives of Real Functions".
    """
    return np.stack([function(values + 1j * step * one).imag / step for one in np.eye(values.shape[1])], axis=1)


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
