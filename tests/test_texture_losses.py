"""What errors of texels cost, against the definitions in float64."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from warp_neural.kernels.texture.losses import known_l2
from warp_neural.texture.job import loss_of
from warp_neural.texture.masking import with_weights
from warp_neural.texture.state import Map

WEIGHTS = 2.0, 2.0, 2.0, 1.0, 0.5, 0.5, 0.5
LOSSES = {
    "l2": known_l2,
    "weighted": known_l2.weighted(*WEIGHTS),
    "angle": replace(known_l2.weighted(*WEIGHTS), normals=(4,)),
    "perceptual": replace(known_l2.weighted(*WEIGHTS), seen=((0, 3), (3, 1))),
    "both": replace(known_l2, normals=(4,), seen=((0, 3),)),
}


def cost(loss, p, t):
    """[samples, 7] and targets with weights to [samples], float64."""
    n = 7
    each = np.where(np.isnan(t[:, :n]), 0, (p - t[:, :n]) ** 2)
    for k, (first, count) in enumerate(loss.seen):
        each[:, first : first + count] *= np.nan_to_num(t[:, n + k, None])
    for c in loss.normals:
        u, v = 2 * p[:, c : c + 3] - 1, 2 * t[:, c : c + 3] - 1
        a, b = (np.sqrt((x * x).sum(-1) + 1e-4) for x in (u, v))
        terms = (2 - 2 * (u * v).sum(-1) / (a * b) + 0.25 * (a - b) ** 2) / 4
        each[:, c : c + 3] = 0
        each[:, c] = np.nan_to_num(terms)
    return each @ np.array(loss.weights or (1.0,) * n) / n


def evaluate(loss, p, t, device):
    """(values, gradients)."""
    vec, vec_target, value, gradient = wp.types.vector(7, float), loss.target_type(7), loss.value(7), loss.gradient(7)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(p: wp.array[vec], t: wp.array[vec_target], values: wp.array[float], gradients: wp.array[vec]):
        i = wp.tid()
        values[i] = value(p[i], t[i])
        gradients[i] = gradient(p[i], t[i])

    pairs = zip((p, t), (vec, vec_target), strict=True)
    inputs = [wp.array(x.astype(np.float32), dtype=dtype, device=device) for x, dtype in pairs]
    outputs = [wp.zeros(len(p), dtype=dtype, device=device) for dtype in (float, vec)]
    wp.launch(kernel, len(p), inputs, outputs, device=device)
    return outputs[0].numpy(), outputs[1].numpy()


@pytest.mark.parametrize("name", LOSSES)
def test_values_and_gradients(name, device):
    loss, random = LOSSES[name], np.random.default_rng(5)
    t = np.float32(random.random((50, 7 + len(loss.seen)))).astype(np.float64)
    t[:5] = np.nan  # where nothing is known
    p = np.float32(random.random((50, 7))).astype(np.float64)
    values, gradients = evaluate(loss, p, t, device)
    np.testing.assert_allclose(values, cost(loss, p, t), rtol=2e-5, atol=1e-7)
    step = 1e-5 * np.eye(7)
    slopes = [(cost(loss, p + h, t) - cost(loss, p - h, t)) / 2e-5 for h in step]
    np.testing.assert_allclose(gradients, np.stack(slopes, -1), rtol=1e-4, atol=1e-6)


def test_weights_of_what_is_seen():
    """Small where the map is rough, large where it is flat, 0 where nothing is known, of mean 1."""
    random = np.random.default_rng(2)
    level = np.full((48, 48, 4), 0.5, np.float32)
    level[:, 24:, :3] += 0.3 * random.standard_normal((48, 24, 3), np.float32)
    level[:4] = np.nan
    (result,) = with_weights([level], [(0, 3)])
    np.testing.assert_array_equal(result[..., :4], level)
    weights = result[..., 4]
    assert (weights[:4] == 0).all() and weights[4:].mean() == pytest.approx(1, rel=1e-5)
    assert weights[10:40, 8:16].min() > 5 * weights[10:40, 32:40].max()
    assert with_weights([level], [])[0].shape == level.shape


def test_places_of_maps():
    """Of their first channels, behind those that vary."""
    maps = (
        Map("ao", "linear", (0.0, 0.0), (0.0, 1.0)),
        Map("normal", "normal", (0.0,) * 3, (1.0,) * 3),
        Map("albedo", "srgb", (0.0,) * 3, (1.0,) * 3),
    )
    loss = loss_of(maps, {"albedo": 3}, {"normal": "angle", "albedo": "perceptual"})
    assert (loss.normals, loss.seen, loss.weights) == ((1,), ((4, 3),), (1, 1, 1, 1, 3, 3, 3))
    assert loss_of(maps, None, {"ao": "l2"}) == known_l2
