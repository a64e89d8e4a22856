"""Random initial weights: `(rng, n_out, n_in) -> [n_out, n_in]` of NumPy, equal on every device for one seed."""

import numpy as np


def xavier_uniform(rng: np.random.Generator, n_out: int, n_in: int) -> np.ndarray:
    """Variance 2 / (n_in + n_out) (Glorot and Bengio 2010): keeps forward and backward signals level."""
    bound = np.sqrt(6 / (n_in + n_out))
    return rng.uniform(-bound, bound, (n_out, n_in))


def xavier_normal(rng: np.random.Generator, n_out: int, n_in: int) -> np.ndarray:
    """As `xavier_uniform`, normally distributed."""
    return rng.normal(0, np.sqrt(2 / (n_in + n_out)), (n_out, n_in))


def he_uniform(rng: np.random.Generator, n_out: int, n_in: int) -> np.ndarray:
    """Variance 2 / n_in (He et al. 2015): for ReLU, which halves the signal's power."""
    bound = np.sqrt(6 / n_in)
    return rng.uniform(-bound, bound, (n_out, n_in))


def he_normal(rng: np.random.Generator, n_out: int, n_in: int) -> np.ndarray:
    """As `he_uniform`, normally distributed."""
    return rng.normal(0, np.sqrt(2 / n_in), (n_out, n_in))
