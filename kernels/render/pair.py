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
    """Materials below `split` are the first set's, the others, numbered from 0 again, the second's."""
    first_type, second_type = first.params_type, second.params_type

    @wp.struct
    class PairParams:
        first: first_type
        second: second_type
        split: int

    return Functions(
        PairParams,
        evaluate=make_choice_of_light(PairParams, first.evaluate, second.evaluate),
        sample=make_choice_of_sample(PairParams, first.sample, second.sample),
        density=make_choice_of_light(PairParams, first.density, second.density),
        albedo=make_choice_of_albedo(PairParams, first.albedo, second.albedo),
    )


def make_choice_of_light(pair_type: Any, first: wp.Function, second: wp.Function) -> wp.Function:
    """Of `evaluate` or `density`."""

    @wp.func
    def chosen(params: pair_type, index: int, uv: wp.vec2, lod: float, light: wp.vec3, view: wp.vec3):
        if index < params.split:
            return first(params.first, index, uv, lod, light, view)
        return second(params.second, index - params.split, uv, lod, light, view)

    return chosen


def make_choice_of_sample(pair_type: Any, first: wp.Function, second: wp.Function) -> wp.Function:
    @wp.func
    def sample(params: pair_type, index: int, uv: wp.vec2, lod: float, view: wp.vec3, u: wp.vec3):
        if index < params.split:
            return first(params.first, index, uv, lod, view, u)
        return second(params.second, index - params.split, uv, lod, view, u)

    return sample


def make_choice_of_albedo(pair_type: Any, first: wp.Function, second: wp.Function) -> wp.Function:
    @wp.func
    def albedo(params: pair_type, index: int, uv: wp.vec2, lod: float, view: wp.vec3):
        if index < params.split:
            return first(params.first, index, uv, lod, view)
        return second(params.second, index - params.split, uv, lod, view)

    return albedo
