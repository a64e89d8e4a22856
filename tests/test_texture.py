"""Texture reads that write their gradient, and the box filter."""

import numpy as np
import pytest
import warp as wp

from warp_neural.errors import InputError
from warp_neural.materials.shading import downsample, read_float, read_vec3


@wp.kernel
def read_kernel(
    albedo: wp.array2d[wp.vec3],
    albedo_gradient: wp.array2d[wp.vec3],
    roughness: wp.array2d[float],
    roughness_gradient: wp.array2d[float],
    loss: wp.array2d[float],
):
    i, j = wp.tid()
    a = read_vec3(albedo, albedo_gradient, i, j)
    loss[i, j] = wp.dot(a, a) * read_float(roughness, roughness_gradient, i, j)


def test_reads_store_their_gradient(device):
    rng = np.random.default_rng(0)
    albedo = wp.array(rng.random((5, 7, 3)), dtype=wp.vec3)
    roughness = wp.array(rng.random((5, 7)), dtype=float)
    gradients = wp.full_like(albedo, wp.vec3(9.0)), wp.full_like(roughness, 9.0)  # stored, not added to
    loss, one = wp.zeros((5, 7), dtype=float), wp.ones((5, 7), dtype=float)
    inputs = [albedo, gradients[0], roughness, gradients[1]]
    wp.launch(read_kernel, dim=(5, 7), inputs=inputs, outputs=[loss], adjoint=True,
              adj_inputs=[None] * 4, adj_outputs=[one])  # fmt: skip
    a, r = albedo.numpy(), roughness.numpy()
    np.testing.assert_allclose(gradients[0].numpy(), 2 * a * r[..., None], rtol=1e-6)
    np.testing.assert_allclose(gradients[1].numpy(), (a * a).sum(axis=-1), rtol=1e-6)


@pytest.mark.parametrize("channels", [1, 3])
def test_box_filter(device, channels):
    image = np.random.default_rng(0).random((6, 10, channels)).astype(np.float32)
    texture = wp.array(image[..., 0], dtype=float) if channels == 1 else wp.array(image, dtype=wp.vec3)
    expected = image.reshape(3, 2, 5, 2, channels).mean(axis=(1, 3))
    np.testing.assert_allclose(downsample(texture).numpy().reshape(3, 5, channels), expected, rtol=1e-6)


def test_odd_sides_are_refused(device):
    with pytest.raises(InputError, match="7 x 6 cannot be halved"):
        downsample(wp.zeros((6, 7), dtype=float))
