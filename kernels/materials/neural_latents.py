"""Latents at a place: eight numbers a texel, of 8 bits in files and for renderers, of 32 in training."""

import warp as wp

from warp_neural.kernels.materials.neural_spec import LATENTS, vec_latents
from warp_neural.kernels.materials.textures import cell


@wp.struct
class LatentTexture:
    """texels: of all levels of all materials, row by row from the top, eight codes each, the first in the lowest bits.
    levels: [materials, levels], start in `texels`, height and width; the last one again where there are fewer. scale:
    [materials, LATENTS], what codes 0 and 1 stand for: a latent is x + code y."""

    texels: wp.array[wp.vec2ui]
    levels: wp.array2d[wp.vec3i]
    scale: wp.array2d[wp.vec2]


@wp.func
def unpacked(codes: wp.vec2ui) -> vec_latents:
    result = vec_latents()
    for c in range(4):
        shift = wp.uint32(8 * c)
        result[c] = float((codes[0] >> shift) & wp.uint32(255))
        result[4 + c] = float((codes[1] >> shift) & wp.uint32(255))
    return result


@wp.func
def corners(level: wp.vec3i, uv: wp.vec2) -> tuple[wp.vec4i, wp.vec2]:
    """The four texels around a place, repeated beyond the edges: top left and right, bottom left and right; and the
    shares of right and bottom. v goes UP the picture."""
    left, right, s = cell(uv[0], level[2])
    top, bottom, t = cell(1.0 - uv[1], level[1])
    first, second = level[0] + top * level[2], level[0] + bottom * level[2]
    return wp.vec4i(first + left, first + right, second + left, second + right), wp.vec2(s, t)


@wp.func
def read_codes(texture: LatentTexture, level: wp.vec3i, uv: wp.vec2) -> vec_latents:
    """Bilinear, as codes."""
    at, share = corners(level, uv)
    top = unpacked(texture.texels[at[0]]) * (1.0 - share[0]) + unpacked(texture.texels[at[1]]) * share[0]
    bottom = unpacked(texture.texels[at[2]]) * (1.0 - share[0]) + unpacked(texture.texels[at[3]]) * share[0]
    return top + (bottom - top) * share[1]


@wp.func
def read_latents(texture: LatentTexture, index: int, uv: wp.vec2, lod: float) -> vec_latents:
    """Trilinear. lod: 0 is the finest level."""
    last = texture.levels.shape[1] - 1
    level = wp.clamp(lod, 0.0, float(last))
    fine = wp.min(int(level), last)  # of NaN too
    share = level - float(fine)
    codes = read_codes(texture, texture.levels[index, fine], uv)
    if share > 0.0:
        coarse = read_codes(texture, texture.levels[index, wp.min(fine + 1, last)], uv)
        codes = codes + (coarse - codes) * share
    for c in range(LATENTS):
        scale = texture.scale[index, c]
        codes[c] = scale[0] + codes[c] * scale[1]
    return codes


@wp.func
def read_trained(texels: wp.array[vec_latents], level: wp.vec3i, uv: wp.vec2) -> vec_latents:
    """Bilinear, of a level in training; gradients go to the four texels."""
    at, share = corners(level, uv)
    s, t = share[0], share[1]
    top = texels[at[0]] * ((1.0 - s) * (1.0 - t)) + texels[at[1]] * (s * (1.0 - t))
    return top + texels[at[2]] * ((1.0 - s) * t) + texels[at[3]] * (s * t)
