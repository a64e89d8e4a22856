"""`Textured`: a material of maps as a set of one."""

import numpy as np
import warp as wp

from warp_neural.errors import find_device
from warp_neural.kernels.render.textured import (
    TexturedParams,
    textured_albedo,
    textured_density,
    textured_evaluate,
    textured_sample,
    vec8,
)
from warp_neural.materials.material import Material
from warp_neural.render.attributes import unit


class Textured:
    """The course's BRDF with albedo, normal, roughness and metalness of `material`, which repeats.

    Mip levels average maps; where that shortens normals, roughness grows (Toksvig 2005, "Mipmapping Normal Maps").
    """

    Params = TexturedParams
    evaluate, sample = staticmethod(textured_evaluate), staticmethod(textured_sample)
    density, albedo = staticmethod(textured_density), staticmethod(textured_albedo)

    def __init__(self, material: Material, *, device: wp.DeviceLike = None):
        levels = mip_levels(material)
        sizes = np.array([level.shape[:2] for level in levels])
        device = find_device(device)
        self.texels = float(np.sqrt(sizes[0].prod()))
        self.params = TexturedParams()
        rows = np.concatenate([level.reshape(-1, 8) for level in levels])
        self.params.texels = wp.array(rows, dtype=vec8, device=device)
        self.params.first = wp.array(np.cumsum([0, *sizes.prod(axis=1)])[:-1], dtype=int, device=device)
        self.params.sizes = wp.array(sizes, dtype=wp.vec2i, device=device)

    def __len__(self) -> int:
        return 1


def mip_levels(material: Material) -> list[np.ndarray]:
    """`TexturedParams.texels` of each level, [height, width, 8] float32, down to one texel."""
    scalars = material.roughness[..., None], material.metalness[..., None]
    mean = np.concatenate([material.albedo, material.normal, *scalars], axis=-1).astype(np.float64)
    levels = []
    while True:
        level = mean.copy()
        length = np.linalg.norm(level[..., 3:6], axis=-1).clip(1e-3, 1)
        level[..., 3:6] = unit(level[..., 3:6])
        level[..., 6] = widened(level[..., 6], length)
        levels.append(level.astype(np.float32))
        if mean.shape[:2] == (1, 1):
            return levels
        mean = halved(halved(mean).swapaxes(0, 1)).swapaxes(0, 1)


def halved(values: np.ndarray) -> np.ndarray:
    """Means of two rows; of an odd number the last one stands twice. [n, ...] to [(n + 1) // 2, ...]"""
    return 0.5 * (values[::2] + np.concatenate([values[1::2], values[-1:]])[: (len(values) + 1) // 2])


def widened(roughness: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Toksvig's factor of the power 2 / alpha^2 - 2 (Blinn-Phong's that is as wide as GGX), alpha = roughness^2."""
    alpha2 = np.clip(roughness, 0.02, 1) ** 4
    power = 2 / alpha2 - 2
    power *= length / (length + power * (1 - length))
    return np.where(length < 1 - 1e-6, (2 / (power + 2)) ** 0.25, roughness)
