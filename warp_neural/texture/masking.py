"""How well an error is seen where it is: texture hides it (the denominator of SSIM; Wang et al. 2004)."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter

SIGMA = 1.5  # texels: of the window, as SSIM has it
FLAT = 0.03**2  # variance: what is flatter shows errors no more
POWER = 0.5  # of SSIM's denominator; 1 gave less SSIM at equal bits (PavingStones070, 1.2 bits)


def with_weights(levels: Sequence[np.ndarray], seen: Sequence[tuple[int, int]]) -> list[np.ndarray]:
    """Levels [height, width, channels] and, after their channels, the weights of errors of each map in `seen` (first
    channel, channels): mean 1 in each level, 0 where nothing is known."""
    return [
        np.concatenate([level, *(_weights(level[..., c : c + n])[..., None] for c, n in seen)], -1) for level in levels
    ]


def _weights(values: np.ndarray) -> np.ndarray:
    known = ~np.isnan(values).any(-1)
    values = np.where(known[..., None], values, values[known].mean(0) if known.any() else 0).astype(np.float64)
    window = {"sigma": (SIGMA, SIGMA, 0), "mode": "wrap", "truncate": 3.5}
    variance = (gaussian_filter(values**2, **window) - gaussian_filter(values, **window) ** 2).mean(-1)
    weights = known / (2 * np.maximum(variance, 0) + FLAT) ** POWER
    return (weights / max(weights[known].mean(), 1e-12) if known.any() else weights).astype(np.float32)
