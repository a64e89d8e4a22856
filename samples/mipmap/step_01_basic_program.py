"""mipmap 1: shade a material with the course's BRDF, one thread a texel. Leaves step_01.png.

    python -m samples.mipmap.step_01_basic_program

A light nearly overhead, the viewer straight above: the wet stones glitter. Expect a mean radiance of 0.158.
"""

import warp as wp

from warp_neural import cli
from warp_neural.materials.shading import brdf, display
from warp_neural.samples.figures import save_picture
from warp_neural.samples.mipmap.maps import Maps, MaterialConfig, source_maps

LIGHT = wp.constant(wp.vec3(*(x / 1.08**0.5 for x in (0.2, 0.2, 1.0))))
VIEW = wp.constant(wp.vec3(0.0, 0.0, 1.0))


@wp.kernel(enable_backward=False)
def render_kernel(
    albedo: wp.array2d[wp.vec3],
    normal: wp.array2d[wp.vec3],
    roughness: wp.array2d[float],
    metalness: wp.array2d[float],
    radiance: wp.array2d[wp.vec3],
):
    i, j = wp.tid()
    n = wp.normalize(normal[i, j])  # filtered normals are shorter than 1
    radiance[i, j] = brdf(albedo[i, j], n, roughness[i, j], metalness[i, j], 1.0, LIGHT, VIEW)


@wp.kernel(enable_backward=False)
def display_kernel(radiance: wp.array2d[wp.vec3], shown: wp.array2d[wp.vec3]):
    i, j = wp.tid()
    shown[i, j] = display(radiance[i, j])


def upload(maps: Maps, device: wp.Device) -> list[wp.array]:
    """Albedo, normal, roughness and metalness, `[height, width]` each."""
    images = [(maps.albedo, wp.vec3), (maps.normal, wp.vec3), (maps.roughness, float), (maps.metalness, float)]
    return [wp.array(image, dtype=dtype, device=device) for image, dtype in images]


def render(textures: list[wp.array]) -> wp.array:
    """Linear radiance, `[height, width]` of vec3."""
    radiance = wp.empty_like(textures[0])
    wp.launch(render_kernel, dim=radiance.shape, inputs=textures, outputs=[radiance], device=radiance.device)
    return radiance


def shown(radiance: wp.array):
    """Displayed values `[height, width, 3]` on the host."""
    values = wp.empty_like(radiance)
    wp.launch(display_kernel, dim=values.shape, inputs=[radiance], outputs=[values], device=values.device)
    return values.numpy()


def main(config: MaterialConfig) -> dict:
    device = cli.resolve_device(config.device)
    _name, maps = source_maps(config, device)
    radiance = render(upload(maps, device))
    save_picture(config.out / "step_01.png", shown(radiance))
    return {"mean_radiance": float(radiance.numpy().mean()), "resolution": list(radiance.shape)}


if __name__ == "__main__":
    cli.run(main, MaterialConfig)
