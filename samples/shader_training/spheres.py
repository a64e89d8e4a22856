"""Spheres under a distant light, shaded by the terms and by a network."""

from functools import cache

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural.materials.shading import display
from warp_neural.samples.shader_training.disney import cosines, disney_terms, radiance

DISTANCE = 4.0  # of the eye from the centre of the unit sphere


@wp.struct
class Surface:
    """base_color: linear RGB in [0, 1]; specular, metallic: [0, 1]; intensity: of the light."""

    base_color: wp.vec3
    specular: float
    metallic: float
    intensity: float


@wp.func
def trace(i: int, j: int, size: int) -> tuple[bool, wp.vec3, wp.vec3]:
    """Whether pixel (row i, column j) of `size` x `size` sees the unit sphere; normal, and direction to the eye."""
    step = 2.2 / (float(size) * wp.sqrt(wp.static(DISTANCE**2 - 1.0)))  # the sphere's outline fills 10/11
    x = (float(j) + 0.5 - 0.5 * float(size)) * step
    y = (0.5 * float(size) - float(i) - 0.5) * step
    ray = wp.normalize(wp.vec3(x, y, -1.0))
    eye = wp.vec3(0.0, 0.0, DISTANCE)
    along = -wp.dot(eye, ray)
    inside = along * along - wp.static(DISTANCE**2 - 1.0)
    normal = wp.normalize(eye + ray * (along - wp.sqrt(wp.max(inside, 0.0))))
    return inside > 0.0, normal, -ray


@wp.func
def shade(terms: wp.vec4, nl: float, surface: Surface) -> wp.vec3:
    """Displayed values."""
    color = radiance(terms, nl, surface.base_color, surface.specular, surface.metallic)
    return display(color * surface.intensity)


@cache
def make_sphere_kernel(func: wp.Function) -> wp.Kernel:
    """dim (spheres, size, size): analytic and neural pictures, black where there is no light."""
    params_type = func.input_types["params"]  # of its shape alone

    @wp.kernel(module="unique", enable_backward=False)
    def sphere_kernel(
        params: params_type,
        surface: Surface,
        roughness: wp.array[float],  # [spheres]
        lights: wp.array[wp.vec3],  # unit vectors towards the light
        analytic: wp.array3d[wp.vec3],
        neural: wp.array3d[wp.vec3],
    ):
        sphere, i, j = wp.tid()
        seen, normal, view = trace(i, j, analytic.shape[1])
        x = cosines(normal, lights[sphere], view, roughness[sphere])
        if seen and x[0] > 0.0:
            y = func(params, x)
            analytic[sphere, i, j] = shade(disney_terms(x), x[0], surface)
            neural[sphere, i, j] = shade(wp.vec4(y[0], y[1], y[2], y[3]), x[0], surface)

    return sphere_kernel


def render(net: wn.MLP, surface: Surface, roughness: np.ndarray, lights: np.ndarray, size: int) -> np.ndarray:
    """Displayed pictures [analytic and neural, spheres, size, size, 3] for roughness [spheres], lights [spheres, 3]."""
    pictures = wp.zeros((2, len(lights), size, size), dtype=wp.vec3, device=net.device)
    inputs = [net.params, surface]
    inputs += [wp.array(values, dtype=t, device=net.device) for values, t in ((roughness, float), (lights, wp.vec3))]
    wp.launch(
        make_sphere_kernel(net.func),
        dim=pictures.shape[1:],
        inputs=[*inputs, pictures[0], pictures[1]],
        device=net.device,
        record_tape=False,
    )
    return pictures.numpy()
