"""A lit sphere with a material's maps: what of an error in them reaches the eye."""

import numpy as np
import warp as wp

from warp_neural.imaging.image import srgb_to_linear
from warp_neural.materials.material import DEFAULTS
from warp_neural.materials.shading import brdf, display

LIGHT = (-0.35, 0.4, 0.85)  # towards it: from the upper left, in front
BRIGHTNESS = wp.constant(2.0)  # of the light, times that of the shader
USED = ("albedo", "normal", "normal_dx", "roughness", "gloss", "metalness", "ao")  # maps that it shows
MIN_Z = wp.constant(0.02)  # normals stay above the surface


@wp.kernel(enable_backward=False)
def sphere_kernel(
    albedo: wp.array2d[wp.vec3],  # linear
    normal: wp.array2d[wp.vec3],  # as stored, (n + 1) / 2
    roughness: wp.array2d[float],
    metalness: wp.array2d[float],
    ao: wp.array2d[float],
    light: wp.vec3,
    picture: wp.array2d[wp.vec3],  # displayed values
):
    """Seen from afar; the maps lie flat over it, one texel a pixel, so that nothing is filtered."""
    i, j = wp.tid()
    radius = 0.5 * float(wp.min(picture.shape[0], picture.shape[1]))
    x = (float(j) + 0.5 - 0.5 * float(picture.shape[1])) / radius
    y = (0.5 * float(picture.shape[0]) - float(i) - 0.5) / radius
    z2 = 1.0 - x * x - y * y
    if z2 > 0.0:
        up = wp.vec3(x, y, wp.sqrt(z2))  # out of the sphere
        right = wp.normalize(wp.vec3(up[2], 0.0, -x))
        local = 2.0 * normal[i, j] - wp.vec3(1.0)
        local = wp.normalize(wp.vec3(local[0], local[1], wp.max(local[2], MIN_Z)))
        bent = right * local[0] + wp.cross(up, right) * local[1] + up * local[2]
        view = wp.vec3(0.0, 0.0, 1.0)
        color = brdf(albedo[i, j], bent, roughness[i, j], metalness[i, j], 1.0, light, view)
        picture[i, j] = display(color * (ao[i, j] * BRIGHTNESS))


def render(maps: dict[str, np.ndarray], device: wp.Device) -> np.ndarray:
    """Displayed [height, width, 3] of maps uint8 [height, width, channels] as stored; absent ones are defaults."""
    shape = next(iter(maps.values())).shape[:2]
    stored = {name: pixels.astype(np.float32) / 255 for name, pixels in maps.items()}
    if "normal_dx" in stored:  # its y points down
        stored["normal"] = np.abs(stored["normal_dx"] - np.float32((0, 1, 0)))
    if "gloss" in stored:
        stored["roughness"] = 1 - stored["gloss"]
    albedo = srgb_to_linear(stored["albedo"]) if "albedo" in stored else np.full((*shape, 3), 0.5)
    normal = stored.get("normal", np.full((*shape, 3), (0.5, 0.5, 1.0)))
    inputs = [wp.array(each, dtype=wp.vec3, device=device) for each in (albedo, normal)]
    for name in ("roughness", "metalness", "ao"):
        values = stored[name][..., 0] if name in stored else np.full(shape, DEFAULTS[name])
        inputs.append(wp.array(values, dtype=float, device=device))
    picture = wp.zeros(shape, dtype=wp.vec3, device=device)
    inputs += [wp.normalize(wp.vec3(*LIGHT)), picture]
    wp.launch(sphere_kernel, shape, inputs=inputs, device=device)
    return picture.numpy()
