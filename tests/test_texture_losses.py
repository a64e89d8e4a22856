"""What errors of texels cost, against the definitions in float64."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from warp_neural.kernels.texture.losses import known_l2
from warp_neural.texture.job import loss_of
from warp_neural.texture.state import Map

WEIGHTS = 2.0, 2.0, 2.0, 1.0, 0.5, 0.5, 0.5
LUMA = np.array([0.299, 0.587, 0.114])
LOSSES = {
    "l2": known_l2,
    "weighted": known_l2.weighted(*WEIGHTS),
    "direction": replace(known_l2.weighted(*WEIGHTS), normals=(4,)),
    "perceptual": replace(known_l2.weighted(*WEIGHTS), colours=(0,)),
    "both": replace(known_l2, normals=(4,), colours=(0,)),
}


def cost(loss, p, t):
    """[samples, 7] to [samples], float64."""
    e = np.where(np.isnan(t), 0, p - t)
    each = e * e
    for c in loss.normals:
        u = 2 * t[:, c : c + 3] - 1
        along = (e[:, c : c + 3] * u).sum(-1) ** 2 / ((u * u).sum(-1) + 1e-6)
        each[:, c] -= np.where(np.isnan(along), 0, 0.9 * along)
    for c in loss.colours:
        y = e[:, c : c + 3] @ LUMA
        each[:, c : c + 3] = y[:, None] ** 2 + 0.25 * (e[:, c : c + 3] - y[:, None]) ** 2
    return each @ np.array(loss.weights or (1.0,) * 7) / 7


def evaluate(loss, p, t, device):
    """(values, gradients)."""
    vec, value, gradient = wp.types.vector(7, float), loss.value(7), loss.gradient(7)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(p: wp.array[vec], t: wp.array[vec], values: wp.array[float], gradients: wp.array[vec]):
        i = wp.tid()
        values[i] = value(p[i], t[i])
        gradients[i] = gradient(p[i], t[i])

    inputs = [wp.array(x.astype(np.float32), dtype=vec, device=device) for x in (p, t)]
    outputs = [wp.zeros(len(p), dtype=dtype, device=device) for dtype in (float, vec)]
    wp.launch(kernel, len(p), inputs, outputs, device=device)
    return outputs[0].numpy(), outputs[1].numpy()


@pytest.mark.parametrize("name", LOSSES)
def test_values_and_gradients(name, device):
    loss, random = LOSSES[name], np.random.default_rng(5)
    t = np.float32(random.random((50, 7))).astype(np.float64)
    t[:5] = np.nan  # where nothing is known
    p = np.float32(random.random((50, 7))).astype(np.float64)
    values, gradients = evaluate(loss, p, t, device)
    np.testing.assert_allclose(values, cost(loss, p, t), rtol=2e-5, atol=1e-7)
    step = 1e-5 * np.eye(7)
    slopes = [(cost(loss, p + h, t) - cost(loss, p - h, t)) / 2e-5 for h in step]
    np.testing.assert_allclose(gradients, np.stack(slopes, -1), rtol=1e-4, atol=1e-6)


def test_what_costs_little():
    """A longer normal, and another colour of the same brightness."""
    loss, t = LOSSES["both"], np.tile([0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 1.0], (3, 1))
    grey, colour, longer = np.array([0.1] * 3), np.array([0.1, 0.1, -0.1 * (LUMA[0] + LUMA[1]) / LUMA[2]]), [0, 0, 0.1]
    p = t.copy()
    p[0, :3] += grey
    p[1, :3] += colour
    p[2, 4:] += longer
    values, _ = evaluate(loss, p, t, "cpu")
    assert values[0] == pytest.approx((grey**2).sum() / 7, rel=1e-4)
    assert values[1] == pytest.approx((colour**2).sum() / 28, rel=1e-4)
    assert values[2] == pytest.approx(0.001 / 7, rel=1e-2)


def test_places_of_maps():
    """Of their first channels, behind those that vary."""
    maps = (
        Map("ao", "linear", (0.0, 0.0), (0.0, 1.0)),
        Map("normal", "normal", (0.0,) * 3, (1.0,) * 3),
        Map("albedo", "srgb", (0.0,) * 3, (1.0,) * 3),
    )
    loss = loss_of(maps, {"albedo": 3}, {"normal": "direction", "albedo": "perceptual"})
    assert (loss.normals, loss.colours, loss.weights) == ((1,), (4,), (1, 1, 1, 1, 3, 3, 3))
    assert loss_of(maps, None, {"ao": "l2"}) == known_l2
