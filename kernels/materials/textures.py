"""Inputs of materials at a place: maps, filtered trilinearly and repeated, or constants."""

from functools import cache

import warp as wp

from warp_neural.kernels.materials.energy import EnergyTables
from warp_neural.kernels.materials.spec import LayeredSpec, channels, place


@wp.struct
class LayeredParams:
    """Materials of one spec, chosen by their index.

    constants: [materials, CHANNELS], of all inputs. texels: of all levels of all maps, row by row from the top, channel
    by channel. levels: [materials * maps, levels], start in `texels`, height and width; the last one again where a map
    has fewer. finer: [materials * maps], how many levels smaller than its material's largest map a map is.
    """

    constants: wp.array2d[float]
    texels: wp.array[float]
    levels: wp.array2d[wp.vec3i]
    finer: wp.array[float]
    energy: EnergyTables


@wp.func
def wrapped(i: int, count: int) -> int:
    rest = i % count
    return wp.where(rest < 0, rest + count, rest)


@wp.func
def cell(at: float, count: int) -> tuple[int, int, float]:
    """The two texels around a coordinate in [0, 1), repeated beyond, and the share of the second."""
    x = (at - wp.floor(at)) * float(count) - 0.5
    low = wp.floor(x)
    return wrapped(int(low), count), wrapped(int(low) + 1, count), x - low


@cache
def make_level(count: int) -> wp.Function:
    """`(texels, level, uv) -> vec`: bilinear, of `count` channels. v goes UP the picture, as normals' y does."""
    vec = wp.types.vector(count, float)

    @wp.func
    def read_level(texels: wp.array[float], level: wp.vec3i, uv: wp.vec2) -> vec:
        left, right, s = cell(uv[0], level[2])
        top, bottom, t = cell(1.0 - uv[1], level[1])
        first, second = level[0] + top * level[2] * count, level[0] + bottom * level[2] * count
        result = vec()
        for c in range(count):
            upper = texels[first + left * count + c] * (1.0 - s) + texels[first + right * count + c] * s
            lower = texels[second + left * count + c] * (1.0 - s) + texels[second + right * count + c] * s
            result[c] = upper + (lower - upper) * t
        return result

    return read_level


@cache
def make_input(spec: LayeredSpec, name: str) -> wp.Function:
    """`(params, index, uv, lod) -> vec` of an input's channels. lod: in texels of the material's largest map."""
    count, first = channels(name), place(name)
    vec = wp.types.vector(count, float)
    if name not in spec.maps:

        @wp.func
        def read_constant(params: LayeredParams, index: int, uv: wp.vec2, lod: float) -> vec:
            result = vec()
            for c in range(count):
                result[c] = params.constants[index, first + c]
            return result

        return read_constant

    position, maps, read_level = spec.maps.index(name), len(spec.maps), make_level(count)

    @wp.func
    def read_map(params: LayeredParams, index: int, uv: wp.vec2, lod: float) -> vec:
        row = index * maps + position
        last = params.levels.shape[1] - 1
        level = wp.clamp(lod - params.finer[row], 0.0, float(last))
        fine = wp.clamp(int(level), 0, last)  # of NaN too
        share = level - float(fine)
        result = vec()
        k = int(0)
        while k < 2:  # not unrolled: one copy of the code for both levels
            weight = wp.where(k == 1, share, 1.0 - share)
            if weight > 0.0:
                result += read_level(params.texels, params.levels[row, wp.min(fine + k, last)], uv) * weight
            k += 1
        return result

    return read_map
