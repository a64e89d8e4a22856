"""The two classical ways to shrink a material's maps."""

import numpy as np

from warp_neural.samples.mipmap.maps import Maps


def mean(image: np.ndarray, factor: int) -> np.ndarray:
    """Box filter, `[height, width, ...]` to a `factor`-th of each side."""
    height, width = image.shape[0] // factor, image.shape[1] // factor
    return image.reshape(height, factor, width, factor, *image.shape[2:]).mean(axis=(1, 3))


def box_filter(source: Maps, factor: int) -> Maps:
    """Every map averaged, as a texture unit does it; normals made unit length again.

    Averaged normals are all alike, and the roughness knows nothing of the ones that went: the highlights of many
    facets become one, small and glaring.
    """
    return _filtered(source, factor)[0]


def toksvig(source: Maps, factor: int) -> Maps:
    """Roughness from the length of the averaged normal: M. Toksvig, "Mipmapping Normal Maps", 2005.

    Equation 1 there shrinks the Blinn-Phong exponent s by f = |N| / (|N| + s (1 - |N|)). For GGX s = 2 / alpha^2 - 2,
    and back (Walter et al. 2007, eq. 8, with Beckmann's alpha taken for GGX's, as engines do).
    """
    maps, length = _filtered(source, factor)
    alpha2 = np.maximum(maps.roughness**2, 1e-3) ** 2  # the shader's floor
    power = 2 / alpha2 - 2
    power *= length / (length + power * (1 - length))
    roughness = (2 / (power + 2)) ** 0.25
    return Maps(maps.albedo, maps.normal, roughness.astype(np.float32), maps.metalness, maps.specular)


def _filtered(source: Maps, factor: int) -> tuple[Maps, np.ndarray]:
    averages = {name: mean(image, factor) for name, image in source.arrays().items()}
    length = np.linalg.norm(averages["normal"], axis=-1)
    averages["normal"] = averages["normal"] / length[..., None]
    return Maps(**averages), np.minimum(length, 1)
