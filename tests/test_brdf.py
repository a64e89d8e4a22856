"""The shader and the loss: values and gradients against float64."""

import numpy as np
import pytest
import reference
import warp as wp

from warp_neural.materials.shading import brdf, display
from warp_neural.samples.mipmap.learn import texel_loss

ROWS = 512


@wp.kernel(enable_backward=False)
def loss_gradient_kernel(
    maps: wp.array2d[float],
    light: wp.array[wp.vec3],
    view: wp.array[wp.vec3],
    target: wp.array[wp.vec3],
    weights: wp.vec2,
    gradient: wp.array2d[float],
):
    i = wp.tid()
    a = wp.vec3(maps[i, 0], maps[i, 1], maps[i, 2])
    n = wp.vec3(maps[i, 3], maps[i, 4], maps[i, 5])
    da, dn, dr, dm, ds, _l, _v, _t, _w = wp.grad(texel_loss)(
        a, n, maps[i, 6], maps[i, 7], maps[i, 8], light[i], view[i], target[i], weights
    )
    for c in range(3):
        gradient[i, c] = da[c]
        gradient[i, 3 + c] = dn[c]
    gradient[i, 6] = dr
    gradient[i, 7] = dm
    gradient[i, 8] = ds


@wp.kernel  # backward enabled, or the other kernel's wp.grad finds empty adjoints: see samples/mipmap/learn.py
def brdf_kernel(
    maps: wp.array2d[float],
    light: wp.array[wp.vec3],
    view: wp.array[wp.vec3],
    color: wp.array[wp.vec3],
    shown: wp.array[wp.vec3],
):
    i = wp.tid()
    a = wp.vec3(maps[i, 0], maps[i, 1], maps[i, 2])
    n = wp.normalize(wp.vec3(maps[i, 3], maps[i, 4], maps[i, 5]))
    color[i] = brdf(a, n, maps[i, 6], maps[i, 7], maps[i, 8], light[i], view[i])
    shown[i] = display(color[i])


@pytest.fixture(scope="module")
def drawn():
    """Rows of maps `[ROWS, 9]`, lights and views, target colours; half the pairs near the mirror direction."""
    rng = np.random.default_rng(3)
    normal = reference.normalize(rng.normal(size=(ROWS, 3)) * 0.3 + [0, 0, 1])
    roughness = rng.uniform(0.1, 1, (ROWS, 1))
    maps = np.concatenate([rng.random((ROWS, 3)), normal, roughness, rng.random((ROWS, 2))], axis=1)
    light, view = (reference.normalize(rng.normal([0, 0, 1.5], 1, (ROWS, 3))) for _ in range(2))
    mirrored = 2 * reference.dot(normal, view)[:, None] * normal - view
    light[::2] = reference.normalize(mirrored + 0.1 * rng.normal(size=(ROWS, 3)))[::2]
    drawn = [array.astype(np.float32).astype(np.float64) for array in (maps, light, view, rng.random((ROWS, 3)))]
    above = np.minimum(reference.dot(normal, light), reference.dot(normal, view))
    assert (above > 0.05).mean() > 0.5 and (above < 0).any()
    return *drawn, np.abs(above) > 0.02  # float32 means nothing across the horizon


def split(maps):
    return maps[:, 0:3], maps[:, 3:6], maps[:, 6], maps[:, 7], maps[:, 8]


def test_brdf_against_float64(device, drawn):
    maps, light, view, _target, sound = drawn
    color, shown = (wp.zeros(ROWS, dtype=wp.vec3) for _ in range(2))
    vectors = [wp.array(v, dtype=wp.vec3) for v in (light, view)]
    wp.launch(brdf_kernel, dim=ROWS, inputs=[wp.array(maps, dtype=float), *vectors, color, shown])
    albedo, normal, *rest = split(maps)
    expected = reference.brdf(albedo, reference.normalize(normal), *rest, light, view)
    np.testing.assert_allclose(color.numpy()[sound], expected[sound], rtol=2e-4, atol=1e-6)  # a lobe's flank: 1e3 ulp
    np.testing.assert_allclose(shown.numpy()[sound], reference.display(expected)[sound], atol=2e-5)
    assert (color.numpy()[expected.max(axis=1) == 0] == 0).all()


def test_peak_of_a_mirror_is_finite_and_right(device):
    """Where 1 + (alpha^2 - 1) (n.h)^2 in float32 would be off by several percent."""
    up = np.array([[0.0, 0.0, 1.0]])
    maps = np.array([[0.5, 0.5, 0.5, 0, 0, 1, 0.0, 0, 1]])
    color, shown = (wp.zeros(1, dtype=wp.vec3) for _ in range(2))
    vectors = [wp.array(up, dtype=wp.vec3) for _ in range(2)]
    wp.launch(brdf_kernel, dim=1, inputs=[wp.array(maps, dtype=float), *vectors, color, shown])
    albedo, normal, *rest = split(maps)
    np.testing.assert_allclose(color.numpy(), reference.brdf(albedo, normal, *rest, up, up), rtol=1e-5)


@pytest.mark.parametrize("weights", [(1.0, 0.0), (0.0, 1.0), (0.3, 20.0)])
def test_loss_gradient_against_float64(device, drawn, weights):
    maps, light, view, target, sound = drawn
    gradient = wp.zeros((ROWS, 9), dtype=float)
    vectors = [wp.array(v, dtype=wp.vec3) for v in (light, view, target)]
    wp.launch(
        loss_gradient_kernel, dim=ROWS, inputs=[wp.array(maps, dtype=float), *vectors, wp.vec2(*weights), gradient]
    )

    def loss(rows):
        return reference.texel_loss(*split(rows), light, view, target, weights)

    expected = reference.derivative(loss, maps)
    scale = np.abs(expected).max(axis=1, keepdims=True) + 1e-6  # a row's small entries are differences of large ones
    worst = (np.abs(gradient.numpy() - expected) / scale)[sound]
    assert np.quantile(worst, 0.99) < 1e-5
    assert worst.max() < 1e-4  # a lobe's flank: 1e3 ulp
