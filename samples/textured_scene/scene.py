"""The renderer: a plane and a sphere under a sun, and any texture that a function `fetch` reads.

`fetch` is a `wp.Function`, `(params, uv: vec2, footprint: mat22, random: vec4) -> vec`. uv: (0, 0) is the texture's
upper left corner, repeats. footprint: columns duv/dx and duv/dy, a pixel to the right and a pixel down. random: four
numbers in [0, 1), new ones for each pixel and frame. Its result has seven channels as maps store them, more are not
read: albedo in sRGB (0 to 2), the normal as (x + 1) / 2 in tangent space, y up the picture (3 to 5), roughness (6).
What `params` is only `fetch` knows: a neural texture's parameters, a struct with arrays, a table of pages.

Radiance is linear.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.nn.random import stream, uniform
from warp_neural.kernels.shading.brdf import brdf
from warp_neural.kernels.shading.tonemap import display
from warp_neural.samples.textured_scene.geometry import (
    NOWHERE,
    Camera,
    Hit,
    intersect,
    ray_of,
    sphere_distance,
    uv_along,
)

SUN = wp.constant(wp.vec3(*np.array([-0.5, 0.75, 0.45]) / np.linalg.norm([-0.5, 0.75, 0.45])))  # towards it
SUN_COLOUR = wp.constant(wp.vec3(2.4, 2.2, 1.9))
SKY = wp.constant(wp.vec3(0.35, 0.45, 0.6))


@wp.func
def linear_of(srgb: float) -> float:
    """IEC 61966-2-1."""
    return wp.where(srgb <= 0.04045, srgb / 12.92, wp.pow((wp.max(srgb, 0.0) + 0.055) / 1.055, 2.4))


@wp.func
def shade(hit: Hit, view: wp.vec3, srgb: wp.vec3, stored_normal: wp.vec3, roughness: float) -> wp.vec3:
    """Radiance towards `view`: sun with a hard shadow, and the sky's as a constant."""
    albedo = wp.vec3(linear_of(srgb[0]), linear_of(srgb[1]), linear_of(srgb[2]))
    n = 2.0 * stored_normal - wp.vec3(1.0)
    across, down = wp.normalize(hit.along_u), wp.normalize(hit.along_v)
    normal = wp.normalize(across * n[0] - down * n[1] + hit.normal * n[2])
    color = 0.3 * wp.cw_mul(albedo, SKY) * (0.5 + 0.5 * normal[1])
    lit = wp.dot(hit.normal, SUN) > 0.0 and sphere_distance(hit.position + 1.0e-3 * hit.normal, SUN) >= NOWHERE
    if lit:
        color += wp.cw_mul(SUN_COLOUR, brdf(albedo, normal, roughness, 0.0, 0.5, SUN, view))
    return color


@wp.func
def fogged(color: wp.vec3, distance: float) -> wp.vec3:
    """The ground fades into the sky towards the horizon."""
    share = wp.exp(-0.04 * distance)
    return color * share + SKY * (1.0 - share)


@cache
def make_render_kernel(fetch: wp.Function, params_type: Any) -> wp.Kernel:
    """dim [height, width]: radiance, and of each pixel the place that it sees and its distance, NOWHERE for the sky."""

    @wp.kernel(module="unique", enable_backward=False)
    def render_kernel(
        params: params_type,
        camera: Camera,
        jitter: wp.vec2,
        share: float,
        seed: wp.uint64,
        frame: int,
        radiance: wp.array2d[wp.vec3],
        places: wp.array2d[wp.vec4],
    ):
        i, j = wp.tid()
        height, width = radiance.shape[0], radiance.shape[1]
        x, y = float(j) + 0.5 + jitter[0], float(i) + 0.5 + jitter[1]
        direction = ray_of(camera, x, y, width, height)
        hit = intersect(camera.eye, direction)
        color = SKY
        if hit.distance < NOWHERE:
            du = uv_along(hit, camera.eye, ray_of(camera, x + 1.0, y, width, height))
            dv = uv_along(hit, camera.eye, ray_of(camera, x, y + 1.0, width, height))
            random = uniform(stream(seed, frame, i * width + j), 0)
            footprint = share * wp.mat22(du[0], dv[0], du[1], dv[1])
            c = fetch(params, hit.uv, footprint, random)
            lit = shade(hit, -direction, wp.vec3(c[0], c[1], c[2]), wp.vec3(c[3], c[4], c[5]), c[6])
            color = fogged(lit, hit.distance)
        radiance[i, j] = color
        places[i, j] = wp.vec4(hit.position[0], hit.position[1], hit.position[2], hit.distance)

    return render_kernel


@wp.kernel(enable_backward=False)
def display_kernel(radiance: wp.array2d[wp.vec3], shown: wp.array2d[wp.vec3]):
    i, j = wp.tid()
    shown[i, j] = display(radiance[i, j])


@dataclass(frozen=True)
class Renderer:
    """A texture as `fetch` and its `params` of type `params_type`, see above; on `device`."""

    fetch: wp.Function
    params_type: Any
    params: Any
    device: wp.Device
    height: int
    width: int

    def render(
        self,
        camera: Camera,
        *,
        jitter: tuple[float, float] = (0, 0),
        share: float = 1.0,
        seed: int = 0,
        frame: int = 0,
    ) -> tuple[wp.array, wp.array]:
        """Radiance, vec3 [height, width], and places, vec4 [height, width]. jitter: of all rays, in pixels. share: of
        a pixel's footprint that the texture is filtered by; less than 1 where a mean of jittered frames does the rest.
        """
        radiance, places = (wp.empty((self.height, self.width), t, device=self.device) for t in (wp.vec3, wp.vec4))
        kernel = make_render_kernel(self.fetch, self.params_type)
        inputs = [self.params, camera, wp.vec2(*jitter), share, seed, frame]
        wp.launch(kernel, radiance.shape, inputs, [radiance, places], device=self.device, record_tape=False)
        return radiance, places

    def supersampled(self, camera: Camera, side: int, seed: int = 0) -> np.ndarray:
        """The mean radiance of side^2 regular places in each pixel, float32 [height, width, 3]."""
        offsets = (np.arange(side) + 0.5) / side - 0.5
        total = np.zeros((self.height, self.width, 3))
        for n, jitter in enumerate((float(x), float(y)) for y in offsets for x in offsets):
            total += self.render(camera, jitter=jitter, seed=seed, frame=n)[0].numpy()
        return (total / side**2).astype(np.float32)


def to_8_bit(radiance: wp.array | np.ndarray, device: wp.DeviceLike = "cpu") -> np.ndarray:
    """Displayed values after the film curve, whole 255ths, float32 [height, width, 3]."""
    if isinstance(radiance, np.ndarray):
        radiance = wp.array(radiance, dtype=wp.vec3, device=device)
    shown = wp.empty_like(radiance)
    wp.launch(display_kernel, radiance.shape, [radiance], [shown], device=radiance.device, record_tape=False)
    return np.rint(255 * shown.numpy()) / np.float32(255)


def camera_at(time: float, aspect: float = 1.5) -> Camera:
    """On a slow orbit: `time` in seconds, 0.1 radians each. aspect: width over height."""
    turn = 0.35 + 0.1 * time
    eye = np.array([4.2 * np.sin(turn), 1.7 + 0.1 * np.sin(0.7 * time), 4.2 * np.cos(turn)])
    forward = np.array([0.0, 0.75, 0.0]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    camera = Camera()
    camera.eye, camera.forward = wp.vec3(*eye), wp.vec3(*forward)
    camera.right = wp.vec3(*(0.5 * aspect * right))
    camera.up = wp.vec3(*(0.5 * np.cross(right, forward)))
    return camera
