"""shader 2: a network learns an image, turned and scaled as it is sampled. Leaves step_02.png and step_02.safetensors.

    python -m samples.shader_training.step_02_simple_training [--image FILE] [--degrees 30] [--scale 1.4]

Nothing but the sample function knows of the rotation: the network learns whatever colour belongs to a position. Expect
25.4 dB on the CPU.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.imaging.image import linear_to_srgb
from warp_neural.samples.figures import save_picture
from warp_neural.samples.shader_training.photo import PhotoConfig, bilinear, load_photo, picture, psnr


@dataclass(frozen=True, kw_only=True)
class Config(PhotoConfig):
    steps: cli.Count | None = None
    """none: 2000 of 2048 samples on the CPU, 10000 of 65,536 on CUDA"""
    degrees: Annotated[float, cli.Between(-1e6, 1e6)] = 30.0
    """the image is turned clockwise by this"""
    scale: cli.Positive = 1.4
    """and shrunk by this; beyond its edges it goes on mirrored"""


@wp.struct
class Photo:
    texels: wp.array2d[wp.vec3]
    transform: wp.mat22


@wp.func
def transformed(photo: Photo, uv: wp.vec2) -> wp.vec3:
    middle = wp.vec2(0.5, 0.5)
    return bilinear(photo.texels, photo.transform * (uv - middle) + middle)


@wp.func
def sample(index: int, random: wn.random.Stream, photo: Photo) -> tuple[wp.vec2, wp.vec3]:
    u = wn.random.uniform(random, 0)
    uv = wp.vec2(u[0], u[1])
    return uv, transformed(photo, uv)


@wp.kernel(enable_backward=False)
def truth_kernel(photo: Photo, image: wp.array2d[wp.vec3]):
    i, j = wp.tid()
    uv = wp.vec2((float(j) + 0.5) / float(image.shape[1]), (float(i) + 0.5) / float(image.shape[0]))
    image[i, j] = transformed(photo, uv)


def main(config: Config) -> dict:
    device = cli.resolve_device(config.device)
    pixels = load_photo(config)
    photo = Photo()
    photo.texels = wp.array(pixels, dtype=wp.vec3, device=device)
    angle = np.radians(config.degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    photo.transform = wp.mat22(*(config.scale * turn).ravel())

    net = wn.MLP(
        2, 3, width=32, depth=3, encoding=wn.encodings.Frequency(octaves=6), seed=config.seed,
        output_activation=wn.activations.sigmoid, device=device,
    )  # fmt: skip
    steps = config.steps or (10000 if device.is_cuda else 2000)
    adam = wn.optim.Adam(lr=wn.optim.cosine(1e-2, 0.0, steps))
    batch = 1 << 16 if device.is_cuda else 2048
    trainer = wn.Trainer(
        net, sample=sample, data=photo, loss=wn.losses.gamma_l2, optimizer=adam, batch=batch, seed=config.seed
    )
    cli.train(trainer, steps, config, "step_02")
    wn.save_network(config.out / "step_02.safetensors", net)

    truth = wp.empty(pixels.shape[:2], dtype=wp.vec3, device=device)
    wp.launch(truth_kernel, dim=truth.shape, inputs=[photo, truth], device=device)
    fit = picture(net, len(pixels))
    row = [pixels, truth.numpy(), fit, 4 * np.abs(fit - truth.numpy())]
    save_picture(config.out / "step_02.png", np.concatenate([linear_to_srgb(np.clip(p, 0, 1)) for p in row], axis=1))
    return {"psnr": psnr(truth.numpy(), fit), "loss": trainer.loss, "steps": steps, "parameters": net.n_parameters}


if __name__ == "__main__":
    cli.run(main, Config)
