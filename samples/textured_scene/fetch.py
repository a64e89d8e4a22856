"""Three ways of reading that the renderer takes: a texel by chance, filtered exactly, and from decoded pictures."""

from functools import cache

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural.kernels.texture.filters import ellipse

MAPS = "albedo", "normal", "roughness"
CHANNELS = 7
vec7 = wp.types.vector(CHANNELS, float)


@cache
def make_exact_fetch(texture: wn.texture.Texture) -> wp.Function:
    """Trilinear, at the level of the footprint's shorter side: eight evaluations of the network."""
    params_type, sample = texture.Params, texture.sample

    @wp.func
    def fetch(params: params_type, uv: wp.vec2, footprint: wp.mat22, random: wp.vec4) -> vec7:
        lod, _line = ellipse(footprint, params.levels.sizes[0])
        return sample(params, uv, lod)

    return fetch


@wp.func
def fetch_picture(picture: wp.array2d[vec7], uv: wp.vec2, footprint: wp.mat22, random: wp.vec4) -> vec7:
    """Bilinear in a picture's finest level, whatever the footprint: for many rays a pixel."""
    height, width = picture.shape[0], picture.shape[1]
    x, y = uv[0] * float(width) - 0.5, uv[1] * float(height) - 0.5
    left, top = wp.floor(x), wp.floor(y)
    fx, fy = x - left, y - top
    i, j = int(top) % height, int(left) % width
    i, j = wp.where(i < 0, i + height, i), wp.where(j < 0, j + width, j)
    below, right = (i + 1) % height, (j + 1) % width
    upper = (1.0 - fx) * picture[i, j] + fx * picture[i, right]
    return (1.0 - fy) * upper + fy * ((1.0 - fx) * picture[below, j] + fx * picture[below, right])


def picture_of(texture: wn.texture.Texture) -> wp.array:
    """All that the texture holds of its finest level, for `fetch_picture`. [height, width] of vec7"""
    maps = texture.decode()
    return wp.array(np.concatenate([maps[name] for name in MAPS], -1), dtype=vec7, device=texture.device)
