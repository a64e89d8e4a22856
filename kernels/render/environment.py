"""Light from afar in all directions: an equirectangular picture, drawn from as it shines.

Up is +y. The middle of the picture lies towards -z, and its right half towards +x, as one sees it from inside.
"""

from typing import Any

import warp as wp

from warp_neural.kernels.shading.sampling_2d import DensityData, sample_density

LEAST_SINE = wp.constant(1.0e-7)


@wp.struct
class EnvironmentData:
    """radiance [height, width]: linear, between the middles of pixels bilinear. weights [height, width]: its luminance
    times the solid angle of pixels, their mean 1. density: pixels as bright as weights. turn: in [0, 1), to the right.
    """

    radiance: wp.array2d[wp.vec3]
    weights: wp.array2d[float]
    density: DensityData
    turn: float


@wp.func
def bilinear(picture: wp.array2d[Any], place: wp.vec2):
    """At a place in [0, 1]^2, x along a row, that wraps from left to right and ends above and below."""
    height, width = picture.shape[0], picture.shape[1]
    x, y = place[0] * float(width) - 0.5, place[1] * float(height) - 0.5
    left, top = wp.floor(x), wp.floor(y)
    fx, fy = x - left, y - top
    j = (int(left) + width) % width
    right = (j + 1) % width
    i, below = wp.clamp(int(top), 0, height - 1), wp.clamp(int(top) + 1, 0, height - 1)
    upper = picture[i, j] * (1.0 - fx) + picture[i, right] * fx
    lower = picture[below, j] * (1.0 - fx) + picture[below, right] * fx
    return upper * (1.0 - fy) + lower * fy


@wp.func
def place_of(environment: EnvironmentData, direction: wp.vec3) -> wp.vec2:
    """Of a unit vector, in [0, 1)^2."""
    x = wp.atan2(direction[0], -direction[2]) / (2.0 * wp.pi) + 0.5 - environment.turn
    sine = wp.sqrt(direction[0] * direction[0] + direction[2] * direction[2])
    return wp.vec2(x - wp.floor(x), wp.atan2(sine, direction[1]) / wp.pi)


@wp.func
def direction_of(environment: EnvironmentData, place: wp.vec2) -> wp.vec3:
    """The inverse of `place_of`."""
    phi, theta = 2.0 * wp.pi * (place[0] - 0.5 + environment.turn), wp.pi * place[1]
    sine = wp.sin(theta)
    return wp.vec3(sine * wp.sin(phi), wp.cos(theta), -sine * wp.cos(phi))


@wp.func
def density_at(environment: EnvironmentData, place: wp.vec2) -> float:
    """Of `sample_environment`, 1/sr: a unit square holds 2 pi^2 sin(theta) sr."""
    sine = wp.max(wp.sin(wp.pi * place[1]), LEAST_SINE)
    return bilinear(environment.weights, place) / (2.0 * wp.pi * wp.pi * sine)


@wp.func
def tent(u: float) -> float:
    """A place in (-1, 1) with density 1 - |x|, of a uniform number."""
    return wp.where(u < 0.5, wp.sqrt(2.0 * u) - 1.0, 1.0 - wp.sqrt(2.0 - 2.0 * u))


@wp.func
def sample_environment(environment: EnvironmentData, u: float, v: float) -> wp.vec2:
    """A place with a density proportional to the bilinear weights: a pixel by its weight, and a tent about its middle.

    So radiance over density, for grey light, changes by no more than the sine within a pixel.
    """
    cell, _density = sample_density(environment.density, u, v)
    height, width = float(environment.weights.shape[0]), float(environment.weights.shape[1])
    j, i = wp.floor(cell[0] * width), wp.floor(cell[1] * height)
    x = j + 0.5 + tent(cell[0] * width - j)
    y = wp.abs(i + 0.5 + tent(cell[1] * height - i))  # reflected at the ends, where `bilinear` repeats the last row
    y = wp.min(y, 2.0 * height - y)
    x = x / width
    return wp.vec2(x - wp.floor(x), y / height)
