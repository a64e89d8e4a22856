"""What errors of texels cost, against the definitions in float64."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from warp_neural.kernels.texture.losses import known_l2
from warp_neural.texture.job import loss_of
from warp_neural.texture.state import Map

WEIGHTS = 2.0, 2.0, 2.0, 1.0, 0.5, 0.5, 0.5
LOSSES = {
    "l2": known_l2,
    "weighted": known_l2.weighted(*WEIGHTS),
    "angle": replace(known_l2.weighted(*WEIGHTS), normals=(4,)),
    "luminance": replace(known_l2.weighted(*WEIGHTS), colours=(0,)),
    "both": replace(known_l2, normals=(4,), colours=(0,)),
}


def cost(loss, p, t):
    """[samples, 7] to [samples], float64."""
    n = 7
    each = np.where(np.isnan(t[:, :n]), 0, (p - t[:, :n]) ** 2)
    for c in loss.colours:
        e = p[:, c : c + 3] - t[:, c : c + 3]
        y = e @ np.array([0.2126, 0.7152, 0.0722])
        each[:, c : c + 3] = 0
        each[:, c] = np.nan_to_num(3 * y**2 + 0.3 * ((e[:, 0] - y) ** 2 + (e[:, 2] - y) ** 2))
    for c in loss.normals:
        u, v = 2 * p[:, c : c + 3] - 1, 2 * t[:, c : c + 3] - 1
        a, b = (np.sqrt((x * x).sum(-1) + 1e-4) for x in (u, v))
        terms = (2 - 2 * (u * v).sum(-1) / (a * b) + 0.25 * (a - b) ** 2) / 4
        each[:, c : c + 3] = 0
        each[:, c] = np.nan_to_num(terms)
    return each @ np.array(loss.weights or (1.0,) * n) / n


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


def test_places_of_maps():
    """Of their first channels, behind those that vary."""
    maps = (
        Map("ao", "linear", (0.0, 0.0), (0.0, 1.0)),
        Map("normal", "normal", (0.0,) * 3, (1.0,) * 3),
        Map("albedo", "srgb", (0.0,) * 3, (1.0,) * 3),
    )
    loss = loss_of(maps, {"albedo": 3}, {"normal": "angle", "albedo": "luminance"})
    assert (loss.normals, loss.colours, loss.weights) == ((1,), (4,), (1, 1, 1, 1, 3, 3, 3))
    assert loss_of(maps, None, {"ao": "l2"}) == known_l2
