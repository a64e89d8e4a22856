"""Which texel a stochastic filter reads: `(x: float, u: float) -> int`, for one of the two directions.

x: place in texels of a level, texel i from i to i + 1. u: a random number in [0, 1). Texel i comes with the probability
of its weight, so the mean of what is read is the filtered value, for one read in place of four, sixteen or more
(Fajardo, Wronski, Salvi and Pharr 2023, "Stochastic Texture Filtering", section 4). All take constant time, and a
function of one's own with this signature is a filter too. Kernels with negative lobes (Mitchell, Catmull-Rom) are left
out: texels drawn by |weight| would need a sign and a factor, a shader cannot take a negative albedo, and the variance
grows.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.errors import is_finite, require

SQRT2 = wp.constant(2.0**0.5)
LEAST = wp.constant(2.0**-25)  # half a step of random numbers: the Gaussian's end is finite
LARGEST_ANISOTROPY = wp.constant(16.0)


@wp.func
def nearest(x: float, u: float) -> int:
    """The texel at x; u is not used."""
    return int(wp.floor(x))


@wp.func
def bilinear(x: float, u: float) -> int:
    """A tent two texels wide, which is a box over a box: the texel at a point within half a texel of x."""
    return int(wp.floor(x + u - 0.5))


@wp.func
def bicubic(x: float, u: float) -> int:
    """The cubic B-spline, four texels wide: smooth, never negative, blurs a little where it is not needed."""
    first = wp.floor(x - 0.5)
    t = x - 0.5 - first
    s = 1.0 - t
    before, last = s * s * s / 6.0, t * t * t / 6.0
    own = (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0
    i = int(first) - 1
    i += wp.where(u >= before, 1, 0)
    i += wp.where(u >= before + own, 1, 0)
    i += wp.where(u >= 1.0 - last, 1, 0)
    return i


@cache
def gaussian(sigma: float = 0.5) -> wp.Function:
    """A Gaussian over the box of a texel. sigma: standard deviation of the Gaussian, in texels of the level.

    Raises `InputError` unless it is a positive number.
    """
    require(is_finite(sigma) and sigma > 0, "sigma", sigma, "a positive number of texels")
    scale = wp.constant(sigma * 2.0**0.5)

    @wp.func
    def gaussian(x: float, u: float) -> int:
        return int(wp.floor(x + scale * wp.erfinv(2.0 * wp.max(u, LEAST) - 1.0)))

    return gaussian


@wp.func
def ellipse(footprint: wp.mat22, size: wp.vec2i) -> tuple[float, wp.vec2]:
    """The level of detail of a pixel's footprint, and the line in uv along which reads spread.

    footprint: columns duv/dx and duv/dy, a pixel to the right and a pixel down. size: height and width of level 0, in
    texels. The level is that of the ellipse's minor axis, or of 1/16 of the major one (Heckbert 1989, "Fundamentals of
    Texture Mapping and Image Warping", section 3.5; McCormack et al. 1999, "Feline"). A uniform point of the line, over
    the width that the level's texels have, has the variance of one of the major axis: the line is as long as the root
    of the difference of their squares, 0 for a circle.
    """
    width, height = float(size[1]), float(size[0])
    x = wp.vec2(footprint[0, 0] * width, footprint[1, 0] * height)
    y = wp.vec2(footprint[0, 1] * width, footprint[1, 1] * height)
    a, b, c = x[0] * x[0] + y[0] * y[0], x[0] * x[1] + y[0] * y[1], x[1] * x[1] + y[1] * y[1]
    major2 = 0.5 * (a + c + wp.sqrt((a - c) * (a - c) + 4.0 * b * b))  # the larger eigenvalue of J J^T
    major = wp.max(wp.sqrt(major2), 1.0e-20)
    minor = wp.max(wp.abs(x[0] * y[1] - x[1] * y[0]) / major, wp.max(major / LARGEST_ANISOTROPY, 1.0))
    angle = 0.5 * wp.atan2(2.0 * b, a - c)
    length = wp.sqrt(wp.max(major2 - minor * minor, 0.0))
    return wp.log2(minor), wp.vec2(wp.cos(angle) * length / width, wp.sin(angle) * length / height)
