"""The Disney terms in float64, straight from their formulas: for comparison."""

import numpy as np


def fresnel(u):
    return np.clip(1 - u, 0, 1) ** 5


def lerp(a, b, t):
    return a + (b - a) * t


def disney_terms(x: np.ndarray) -> np.ndarray:
    """[n, 5] of N.L, N.V, N.H, L.H, roughness to [n, 4]."""
    nl, nv, nh, lh, r = np.moveaxis(np.asarray(x, np.float64), -1, 0)
    flat = lh**2 * r
    s = lerp(1, flat, fresnel(nl)) * lerp(1, flat, fresnel(nv))
    diffuse = 1.25 * (s * (1 / (nl + nv) - 0.5) + 0.5) / np.pi

    a = np.maximum(0.001, r**2)
    b = a * ((1 - nh**2) / a**2 + nh**2)

    def g(c):
        return 1 / (c + np.sqrt(a**2 * (1 - c**2) + c**2))

    specular = g(nl) * g(nv) / (np.pi * b**2)

    q = 0.0001

    def k(c):
        return 1 / (c + np.sqrt(0.0625 + c**2 - 0.0625 * c**2))

    d = (q - 1) / (np.pi * np.log(q) * (1 + (q - 1) * nh**2))
    coat = 0.25 * k(nl) * k(nv) * lerp(0.04, 1, fresnel(lh)) * d
    return np.stack([diffuse, specular, fresnel(lh), coat], axis=-1)
