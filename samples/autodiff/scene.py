"""The distance field of step 5: a twisted box, melting drops and a gyroid over a floor, in any precision."""

from functools import cache
from typing import NamedTuple

import warp as wp

import warp_neural as wn

LEFT, RIGHT = -1.7, 1.75  # where the twisted box and the gyroid stand


class Scene(NamedTuple):
    distance: wp.Function
    """`(p) -> distance`"""
    normal: wp.Function
    """`(p) -> unit normal`, by forward mode"""
    normal_by_differences: wp.Function
    """`(p, h) -> unit normal`, by central differences"""


@cache
def make_scene(real: type, vec3: type) -> Scene:
    """Device functions of one precision: `wp.float32` or `wp.float64` and its vectors."""

    @wp.func
    def smooth_min(a: real, b: real, k: real) -> real:
        h = wp.max(k - wp.abs(a - b), real(0.0)) / k
        return wp.min(a, b) - h * h * k * real(0.25)

    @wp.func
    def twisted_box(p: vec3) -> real:
        c, s = wp.cos(real(1.6) * p[1]), wp.sin(real(1.6) * p[1])
        q = wp.abs(vec3(c * p[0] - s * p[2], p[1], s * p[0] + c * p[2])) - vec3(real(0.38), real(0.8), real(0.38))
        outside = wp.length(wp.max(q, vec3(real(0.0))))
        return (outside + wp.min(wp.max(q), real(0.0))) * real(0.75) - real(0.07)  # a twist stretches distances

    @wp.func
    def drops(p: vec3) -> real:
        d = wp.length(p - vec3(real(0.0), real(-0.35), real(0.0))) - real(0.5)
        for i in range(7):
            angle = real(i) * real(0.9)
            center = vec3(real(0.42) * wp.cos(angle), real(i) * real(0.17) - real(0.5), real(0.42) * wp.sin(angle))
            d = smooth_min(d, wp.length(p - center) - real(0.24), real(0.22))
        return d

    @wp.func
    def gyroid(p: vec3) -> real:
        q = p * real(6.0)
        g = wp.sin(q[0]) * wp.cos(q[1]) + wp.sin(q[1]) * wp.cos(q[2]) + wp.sin(q[2]) * wp.cos(q[0])
        shell = wp.abs(g) / real(10.0) - real(0.035)
        ball = wp.length(p) - real(0.88)
        return wp.max(ball, shell)

    @wp.func
    def distance(p: vec3) -> real:
        left = twisted_box(p - vec3(real(LEFT), real(0.0), real(0.0)))
        right = gyroid(p - vec3(real(RIGHT), real(0.0), real(0.0)))
        solid = wp.min(wp.min(left, right), drops(p))
        return smooth_min(solid, p[1] + real(0.9), real(0.15))

    distance_jvp = wn.autodiff.make_jvp(distance)

    @wp.func
    def normal(p: vec3) -> vec3:
        _dx, x = distance_jvp(p, vec3(real(1.0), real(0.0), real(0.0)))
        _dy, y = distance_jvp(p, vec3(real(0.0), real(1.0), real(0.0)))
        _dz, z = distance_jvp(p, vec3(real(0.0), real(0.0), real(1.0)))
        return wp.normalize(vec3(x, y, z))

    @wp.func
    def normal_by_differences(p: vec3, h: real) -> vec3:
        x, y, z = vec3(h, real(0.0), real(0.0)), vec3(real(0.0), h, real(0.0)), vec3(real(0.0), real(0.0), h)
        return wp.normalize(
            vec3(
                distance(p + x) - distance(p - x), distance(p + y) - distance(p - y), distance(p + z) - distance(p - z)
            )
        )

    return Scene(distance, normal, normal_by_differences)


SINGLE = make_scene(wp.float32, wp.vec3)
DOUBLE = make_scene(wp.float64, wp.vec3d)
