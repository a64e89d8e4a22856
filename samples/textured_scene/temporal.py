"""Accumulation over frames: what a pixel sees was seen before, elsewhere in the picture, and is averaged with that."""

import numpy as np
import warp as wp

from warp_neural.samples.textured_scene.scene import NOWHERE, Camera, normal_at, pixel_of

FRAMES = wp.constant(16.0)  # of the moving average: later frames weigh 1/16
TOLERANCE = wp.constant(0.01)  # of the distance, from the tangent plane: farther off it is another surface


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
    """dim [height, width]. history: mean radiance and how many frames it is the mean of.

    The place that a pixel sees is projected into the frame before (Yang et al. 2020, "A Survey of Temporal Antialiasing
    Techniques", section 3). Of the four pixels around it those count that saw the same surface, by their distances from
    its tangent plane. Nothing but the camera moves, so this rejection is enough: a clamp to the colours around the
    pixel, for changes that a projection does not know, would keep some of the noise of the one frame it is made of.
    """
    i, j = wp.tid()
    height, width = radiance.shape[0], radiance.shape[1]
    place = places[i, j]
    mean = wp.vec4()
    total = float(0.0)
    if place[3] < NOWHERE:
        position = wp.vec3(place[0], place[1], place[2])
        normal = normal_at(position)
        at = pixel_of(camera_before, position, width, height) - jitter - wp.vec2(0.5)  # pixels' middles are whole
        left, top = wp.floor(at[0]), wp.floor(at[1])
        for k in range(4):
            row, column = int(top) + k / 2, int(left) + k % 2
            if row >= 0 and row < height and column >= 0 and column < width:
                other = places_before[row, column]
                off = wp.abs(wp.dot(wp.vec3(other[0], other[1], other[2]) - position, normal))
                if other[3] < NOWHERE and off < TOLERANCE * place[3]:
                    weight = (1.0 - wp.abs(at[0] - float(column))) * (1.0 - wp.abs(at[1] - float(row)))
                    mean += weight * history_before[row, column]
                    total += weight
    frames = float(1.0)
    if total > 0.01:
        mean = mean / total
        frames = wp.min(mean[3] + 1.0, FRAMES)
    color = wp.vec3(mean[0], mean[1], mean[2]) * (1.0 - 1.0 / frames) + radiance[i, j] / frames
    history[i, j] = wp.vec4(color[0], color[1], color[2], frames)


class Accumulator:
    """`add` takes one frame after the other and returns the mean radiance, float32 [height, width, 3]."""

    def __init__(self) -> None:
        self.before = None

    def add(self, camera: Camera, radiance: wp.array, places: wp.array, jitter: tuple[float, float]) -> np.ndarray:
        device, shape = radiance.device, radiance.shape
        history = wp.empty(shape, dtype=wp.vec4, device=device)
        nowhere = wp.full(shape, wp.vec4(0.0, 0.0, 0.0, float(NOWHERE)), device=device)
        before = self.before or (camera, nowhere, wp.zeros_like(history))
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
