"""Two sets of materials as one."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp


class Functions(NamedTuple):
    """Of a set of materials, see `warp_neural.render.materials`; params_type is its `Params`."""

    params_type: Any
    evaluate: wp.Function
    sample: wp.Function
    density: wp.Function
    albedo: wp.Function


@cache
def make_pair(first: Functions, second: Functions) -> Functions:
    """Materials below `split` are the first set's, the others, numbered from 0 again, the second's.

    detail: what each set wants added to the level of detail.
    """
    first_type, second_type = first.params_type, second.params_type
    evaluate_0, evaluate_1 = first.evaluate, second.evaluate
    sample_0, sample_1 = first.sample, second.sample
    density_0, density_1 = first.density, second.density
    albedo_0, albedo_1 = first.albedo, second.albedo

    @wp.struct
    class PairParams:
        first: first_type
        second: second_type
        split: int
        detail: wp.vec2

    @wp.func
    def evaluate(p: PairParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> wp.vec3:
        if index < p.split:
            return evaluate_0(p.first, index, uv, lod + p.detail[0], light, view)
        return evaluate_1(p.second, index - p.split, uv, lod + p.detail[1], light, view)

    @wp.func
    def sample(p: PairParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3) -> wp.vec3:
        if index < p.split:
            return sample_0(p.first, index, uv, lod + p.detail[0], view, u)
        return sample_1(p.second, index - p.split, uv, lod + p.detail[1], view, u)

    @wp.func
    def density(p: PairParams, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3) -> float:
        if index < p.split:
            return density_0(p.first, index, uv, lod + p.detail[0], light, view)
        return density_1(p.second, index - p.split, uv, lod + p.detail[1], light, view)

    @wp.func
    def albedo(p: PairParams, index: int, uv: wp.vec2, lod: float, view: wp.vec3) -> wp.vec3:
        if index < p.split:
            return albedo_0(p.first, index, uv, lod + p.detail[0], view)
        return albedo_1(p.second, index - p.split, uv, lod + p.detail[1], view)

    return Functions(PairParams, evaluate, sample, density, albedo)
