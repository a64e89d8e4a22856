"""Contexts fitted to latents that were drawn from a known one."""

import numpy as np

from warp_neural.texture.contexts import UNIT, value
from warp_neural.texture.fit import fit


def drawn(rows, columns, rng):
    """Latents of two channels and parents of cells twice as large: channel 0 after the left neighbour and the parents,
    channel 1 after channel 0."""
    q = np.zeros((rows, columns, 2), int)
    parents = np.round(rng.laplace(size=(rows // 2, columns // 2, 1)))
    above = sum(np.abs(np.roll(parents, (-i, -j), (0, 1))) for i in (0, 1) for j in (0, 1)).repeat(2, 0).repeat(2, 1)
    noise = rng.laplace(size=q.shape)
    for y in range(rows):
        for x in range(columns):
            left = q[y, x - 1, 0] if x else 0
            q[y, x, 0] = np.round(0.5 * left + noise[y, x, 0] * (0.25 + 0.25 * abs(left) + 0.125 * above[y, x, 0]))
            q[y, x, 1] = np.round(-0.75 * q[y, x, 0] + noise[y, x, 1] * (0.5 + 0.5 * abs(q[y, x, 0])))
    return np.clip(q, -127, 127).astype(np.int8), parents.astype(np.int8)


def test_the_weights_of_a_known_context_are_found():
    latents, parents = drawn(192, 192, np.random.default_rng(0))
    context = fit([latents], [parents], 256, np.ones(2, bool))
    scale_0, mean_0, scale_near, mean_near, scale_of, mean_of, scale_parent = (
        value(array) / UNIT for array in context.arrays
    )
    assert np.allclose(scale_0, (0.25, 0.5), rtol=0.15) and abs(mean_0).max() < 0.03
    assert np.allclose((scale_near[0, 0], scale_of[0]), (0.25, 0.5), rtol=0.15)
    assert np.allclose((mean_near[0, 0], mean_of[0]), (0.5, -0.75), rtol=0.1)
    assert np.allclose(scale_parent[0], (0.125, 0), rtol=0.15, atol=0.01)
    scale_near[0, 0] = mean_near[0, 0] = 0
    assert scale_near.max() < 0.05 and abs(mean_near).max() < 0.02
    assert (mean_near == 0).mean() > 0.5  # they save less than they cost


def test_few_cells_are_enough():
    latents, parents = drawn(2, 2, np.random.default_rng(1))
    context = fit([latents], [parents], 256, np.ones(2, bool))
    assert all(np.isfinite(array).all() for array in context.arrays) and context.integers.dtype == np.int32
