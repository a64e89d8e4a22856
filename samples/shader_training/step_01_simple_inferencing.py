"""shader 1: a network from a file shades a sphere, one inference a pixel. Leaves step_01.png.

    python -m samples.shader_training.step_01_simple_inferencing [--network FILE]

The file may be ours (.safetensors) or RTXNS's (.bin, .json). Without one, a small network is trained for some seconds
and written first. Expect a PSNR of 51 dB against the analytic BRDF from it, and 69 dB from one trained on a GPU.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.imaging.image import displayed_psnr
from warp_neural.samples.figures import save_picture
from warp_neural.samples.shader_training.disney import cosines
from warp_neural.samples.shader_training.look import LookConfig, check, light_of, surface_of
from warp_neural.samples.shader_training.spheres import Surface, render, shade, trace
from warp_neural.samples.shader_training.train import Recipe, load, make_net, train


@dataclass(frozen=True, kw_only=True)
class Config(LookConfig):
    epochs: Annotated[int, cli.Between(1, 10**5)] = 15
    """of 100 steps each, for the network that is trained if none is given"""


@cache
def make_shade_kernel(net_func: wp.Function) -> wp.Kernel:
    params_type = net_func.input_types["params"]  # of its shape alone

    @wp.kernel(module="unique", enable_backward=False)
    def shade_kernel(
        params: params_type, surface: Surface, roughness: float, light: wp.vec3, image: wp.array2d[wp.vec3]
    ):
        i, j = wp.tid()
        seen, normal, view = trace(i, j, image.shape[0])
        if not seen:
            return  # threads may leave before the network: the others of the warp go on
        x = cosines(normal, light, view, roughness)
        y = net_func(params, x)  # the encoding, and three layers of 32 on tensor cores
        terms = wp.vec4(y[0], y[1], y[2], y[3])
        if x[0] > 0.0:
            image[i, j] = shade(terms, x[0], surface)

    return shade_kernel


def main(config: Config) -> dict:
    check(config)
    device = cli.resolve_device(config.device)
    if config.network is None:
        small = make_net(device, config.seed)
        train(small, Recipe(config.epochs, batch=1024), config)
        config = replace(config, network=config.out / "small.safetensors")
        wn.save_network(config.network, small)
    net = load(config.network, device)

    surface, light = surface_of(config), light_of(config)
    image = wp.zeros((config.size, config.size), dtype=wp.vec3, device=device)
    inputs = [net.params, surface, config.roughness, wp.vec3(*light), image]
    wp.launch(make_shade_kernel(net.func), dim=image.shape, inputs=inputs, device=device)

    analytic = render(net, surface, np.array([config.roughness]), light[None], config.size)[0, 0]
    save_picture(config.out / "step_01.png", np.concatenate([analytic, image.numpy()], axis=1))
    return {"psnr": displayed_psnr(analytic, image.numpy()), "network": str(config.network)}


if __name__ == "__main__":
    cli.run(main, Config)
