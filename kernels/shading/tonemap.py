"""From linear radiance to what a screen shows: the course's filmic curve, then gamma."""

import warp as wp


@wp.func
def aces(x: float) -> float:
    """Narkowicz's fit of the ACES film curve (2016), in [0, 1]; 1 is reached at x = 8.7."""
    y = wp.abs(x)
    return wp.min(y * (2.51 * y + 0.03) / (y * (2.43 * y + 0.59) + 0.14), 1.0)


@wp.func
def display(color: wp.vec3) -> wp.vec3:
    """Displayed values in [0, 1]: the film curve, then gamma 1/2.2."""
    g = 1.0 / 2.2
    return wp.vec3(wp.pow(aces(color[0]), g), wp.pow(aces(color[1]), g), wp.pow(aces(color[2]), g))


@wp.func
def display_smooth(color: wp.vec3) -> wp.vec3:
    """`display` for losses: 1e-4 under the root, since gamma's slope at black is infinite; at most 0.016 brighter."""
    g = 1.0 / 2.2
    o = 1.0e-4
    return wp.vec3(wp.pow(aces(color[0]) + o, g), wp.pow(aces(color[1]) + o, g), wp.pow(aces(color[2]) + o, g))
