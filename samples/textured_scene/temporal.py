"""Accumulation over frames: what a pixel sees was seen before, elsewhere in the picture, and is averaged with that."""

import numpy as np
import warp as wp

from warp_neural.samples.textured_scene.geometry import Camera, normal_at, pixel_of

FRAMES = wp.constant(8.0)  # of the moving average: later frames weigh 1/8, as much noise is left as of 15
LARGEST = wp.constant(1.0e30)  # radiance
OTHER_FRAMES = wp.constant(3.0)  # that another surface's history counts as, at most
TOLERANCE = wp.constant(0.01)  # of the distance, from the tangent plane: farther off it is another surface


@wp.func
def pixel_before(history: wp.array2d[wp.vec4], row: int, column: int) -> wp.vec4:
    """The nearest that there is."""
    return history[wp.clamp(row, 0, history.shape[0] - 1), wp.clamp(column, 0, history.shape[1] - 1)]


@wp.func
def catmull_rom(t: float) -> wp.vec4:
    """Weights of the four pixels around a place, t in [0, 1) from the second to the third."""
    t2, t3 = t * t, t * t * t
    return 0.5 * wp.vec4(2.0 * t2 - t - t3, 2.0 - 5.0 * t2 + 3.0 * t3, t + 4.0 * t2 - 3.0 * t3, t3 - t2)


@wp.func
def history_at(history: wp.array2d[wp.vec4], at: wp.vec2) -> wp.vec4:
    """Between pixels, whose middles are at whole numbers: bilinear would blur the picture a little in every frame."""
    left, top = wp.floor(at[0]), wp.floor(at[1])
    across, down = catmull_rom(at[0] - left), catmull_rom(at[1] - top)
    total = wp.vec4()
    for i in range(4):
        for j in range(4):
            total += down[i] * across[j] * pixel_before(history, int(top) + i - 1, int(left) + j - 1)
    return wp.max(total, wp.vec4())


@wp.func
def same_surface(places: wp.array2d[wp.vec4], at: wp.vec2, place: wp.vec4) -> bool:
    """Whether all four pixels around `at` saw points near the tangent plane of a place."""
    position = wp.vec3(place[0], place[1], place[2])
    normal, same = normal_at(position), True
    for k in range(4):
        row, column = int(wp.floor(at[1])) + k / 2, int(wp.floor(at[0])) + k % 2
        other = pixel_before(places, row, column)
        off = wp.abs(wp.dot(wp.vec3(other[0], other[1], other[2]) - position, normal))
        same = same and off < TOLERANCE * wp.min(place[3], other[3])
    return same


@wp.func
def within_neighbours(radiance: wp.array2d[wp.vec3], i: int, j: int, color: wp.vec3) -> wp.vec3:
    """Clamped to the range of the 3 x 3 pixels around (i, j)."""
    low, high = wp.vec3(LARGEST), wp.vec3(0.0)
    for k in range(9):
        row = wp.clamp(i + k / 3 - 1, 0, radiance.shape[0] - 1)
        column = wp.clamp(j + k % 3 - 1, 0, radiance.shape[1] - 1)
        low, high = wp.min(low, radiance[row, column]), wp.max(high, radiance[row, column])
    return wp.min(wp.max(color, low), high)


@wp.kernel(enable_backward=False)
def accumulate_kernel(
    radiance: wp.array2d[wp.vec3],
    places: wp.array2d[wp.vec4],
    jitter: wp.vec2,
    camera_before: Camera,
    places_before: wp.array2d[wp.vec4],
    history_before: wp.array2d[wp.vec4],
    history: wp.array2d[wp.vec4],
):
    """dim [height, width]. history: mean radiance and of how many frames it is the mean.

    The place that a pixel sees is projected into the frame before, and the history there taken in (Yang et al. 2020,
    "A Survey of Temporal Antialiasing Techniques", sections 3 and 4). Nothing but the camera moves, so what the same
    surface had there is right; clamped to the colours around it would be as noisy as the one frame that they are of. It
    is clamped where another surface was seen, at outlines and where something comes into view, which then counts as few
    frames, and until the mean is one of `FRAMES`. Highlights move over the surface and lag behind.
    """
    i, j = wp.tid()
    height, width = radiance.shape[0], radiance.shape[1]
    place = places[i, j]
    at = pixel_of(camera_before, wp.vec3(place[0], place[1], place[2]), width, height) - jitter - wp.vec2(0.5)
    inside = at[0] > -0.5 and at[1] > -0.5 and at[0] < float(width) - 0.5 and at[1] < float(height) - 0.5
    old, frames = wp.vec3(), float(1.0)
    if inside:
        before = history_at(history_before, at)
        old = wp.vec3(before[0], before[1], before[2])
        frames = wp.min(before[3] + 1.0, FRAMES)
        same = same_surface(places_before, at, place)
        if not same or frames < FRAMES:
            old = within_neighbours(radiance, i, j, old)
        if not same:
            frames = wp.min(frames, OTHER_FRAMES + 1.0)
    mean = old + (radiance[i, j] - old) / frames
    history[i, j] = wp.vec4(mean[0], mean[1], mean[2], frames)


class Accumulator:
    """`add` takes one frame after the other and returns the mean radiance, float32 [height, width, 3]."""

    def __init__(self) -> None:
        self.before = None

    def add(self, camera: Camera, radiance: wp.array, places: wp.array, jitter: tuple[float, float]) -> np.ndarray:
        device, shape = radiance.device, radiance.shape
        history = wp.empty(shape, dtype=wp.vec4, device=device)
        before = self.before or (camera, places, wp.zeros_like(history))  # a history of no frames
        inputs = [radiance, places, wp.vec2(*jitter), *before, history]
        wp.launch(accumulate_kernel, shape, inputs, device=device, record_tape=False)
        self.before = camera, places, history
        return history.numpy()[..., :3]


def jitter_of(frame: int) -> tuple[float, float]:
    """In pixels, -1/2 to 1/2: Halton's sequence to bases 2 and 3, so that frames together cover a pixel evenly."""
    return radical_inverse(frame + 1, 2) - 0.5, radical_inverse(frame + 1, 3) - 0.5


def radical_inverse(n: int, base: int) -> float:
    """The digits of n mirrored at the point."""
    value, digit = 0.0, 1.0 / base
    while n:
        value += n % base * digit
        n, digit = n // base, digit / base
    return value
