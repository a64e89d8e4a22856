"""The lecture's benchmark: a neural texture, trained on a picture of 100 MB, in plain arithmetic and accelerated.

The texture is a grid of latent features, bilinear, and a network that turns them into a colour. A sample is a pixel at
random; colours are sRGB values in [0, 1], and so is the squared error.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural.samples.hardware_acceleration.small_network import seconds_a_step

JUDGED = 1 << 18  # pixels, drawn once, that the PSNR is measured on


@dataclass(frozen=True)
class Version:
    """How the one network is computed. fused: in one kernel with everything else of the step, None where possible."""

    implementation: str
    precision: str
    fused: bool | None = None


VERSIONS = {
    "per_thread": Version("per_thread", "float32"),
    "unfused": Version("cooperative", "float16", fused=False),
    "float32": Version("cooperative", "float32"),
    "float16": Version("cooperative", "float16"),
}


@dataclass(frozen=True)
class Size:
    """Of the texture: latents along one side, their channels, the network. batch: pixels a step."""

    latents: int
    batch: int
    channels: int = 8
    width: int = 64
    depth: int = 2


@wp.func
def color(picture: wp.array2d[wp.vec3ub], i: int, j: int) -> wp.vec3:
    code = picture[i, j]
    return wp.vec3(float(code[0]), float(code[1]), float(code[2])) / 255.0


@wp.func
def sample(index: int, random: wn.random.Stream, picture: wp.array2d[wp.vec3ub]):
    u = wn.random.uniform(random, 0)
    height, width = picture.shape[0], picture.shape[1]
    i, j = int(u[0] * float(height)), int(u[1] * float(width))
    return wp.vec2((float(j) + 0.5) / float(width), (float(i) + 0.5) / float(height)), color(picture, i, j)


def make_network(version: Version, size: Size, seed: int, device: wp.Device) -> wn.MLP:
    return wn.MLP(
        n_in=2,
        n_out=3,
        width=size.width,
        depth=size.depth,
        encoding=wn.encodings.LatentTexture(size.latents, size.latents, size.channels, initial=(-0.1, 0.1)),
        precision=version.precision,
        implementation=version.implementation,
        seed=seed,
        device=device,
    )


def train(version: Version, size: Size, steps: int, picture: wp.array, seed: int, quiet: bool) -> tuple[wn.MLP, float]:
    """The trained network and seconds a step."""
    net = make_network(version, size, seed, picture.device)
    trainer = wn.Trainer(
        net,
        sample=sample,
        data=picture,
        optimizer=wn.optim.Adam(lr=wn.optim.cosine(0.01, 1e-4, steps)),
        batch=size.batch,
        fused=version.fused,
        seed=seed,
    )
    return net, seconds_a_step(trainer, steps, quiet)


def evaluate(net: wn.MLP, picture: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """8-bit sRGB values [n, 3] of the network at pixels (rows[i], columns[i]) of the picture."""

    @wp.kernel(module="unique", enable_backward=False)
    def evaluate_kernel(params: net.Params, uv: wp.array[wp.vec2], colors: wp.array[wp.vec3]):
        i = wp.tid()
        colors[i] = net.func(params, uv[i])

    height, width = picture.shape[:2]
    points = np.stack([(columns + 0.5) / width, (rows + 0.5) / height], axis=-1)
    uv = wp.array(points, dtype=wp.vec2, device=net.device)
    colors = wp.empty(len(points), dtype=wp.vec3, device=net.device)
    wp.launch(evaluate_kernel, len(points), inputs=[net.params, uv, colors], device=net.device)
    return np.rint(255 * np.clip(colors.numpy(), 0, 1))


def psnr(net: wn.MLP, picture: np.ndarray) -> float:
    """On `JUDGED` pixels drawn at random, in 8-bit sRGB values: dB, within 0.05 of that of all pixels."""
    rng = np.random.default_rng(0)
    rows, columns = (rng.integers(0, n, JUDGED) for n in picture.shape[:2])
    error = np.square(evaluate(net, picture, rows, columns) - picture[rows, columns]).mean()
    return float(10 * np.log10(255**2 / error))


def crop(net: wn.MLP, picture: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """The middle of the picture and of what was learned, uint8 [side, side, 3], or all of a smaller picture."""
    height, width = (min(n, side) for n in picture.shape[:2])
    top, left = (picture.shape[0] - height) // 2, (picture.shape[1] - width) // 2
    rows, columns = (axis.ravel() for axis in np.mgrid[top : top + height, left : left + width])
    learned = evaluate(net, picture, rows, columns).astype(np.uint8).reshape(height, width, 3)
    return picture[top : top + height, left : left + width], learned
