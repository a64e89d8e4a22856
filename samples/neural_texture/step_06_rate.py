"""neural texture 6: latents that cost what they are worth. Leaves step_06.png.

    python -m samples.neural_texture.step_06_rate [--material FOLDER]

A file need not give every latent 3 bits: an arithmetic coder takes -log2 p for a number of probability p. So that many
latents become 0 and cheap, the loss gets a second part, a weight times the bits a texel that a Laplace distribution, of
one trained width for each channel, says (Balle et al. 2017, eq. 9). Which latents are worth their bits is found in
training. Grids are those of step 3. Bits are counted as an ideal coder would need them, and 16 for each width.
Expect 0.3 dB more at 5 bits a texel, 0.6 at 4, 1.3 at 3.
"""

import numpy as np
import warp as wp

from warp_neural import cli
from warp_neural.samples.neural_texture.step_01_latent_texture import train
from warp_neural.samples.neural_texture.step_03_learned_kernels import GRIDS
from warp_neural.samples.neural_texture.step_05_straight_through import FINISH, finish_kernel
from warp_neural.samples.neural_texture.target import Config, report
from warp_neural.samples.neural_texture.texture import Point, Texture
from warp_neural.texture.maps import TextureSet
from warp_neural.train.optim import Adam, Parameters

RATE_WEIGHTS = 1e-4, 3e-4, 1e-3  # mean squared error that a bit a texel is worth
LIMIT = 127  # of int8


@wp.func
def tail(x: float, width: float) -> float:
    """The mass beyond x >= 0 of a Laplace distribution of mean deviation `width`."""
    return 0.5 * wp.exp(-x / width)


@wp.func
def bits_of(latent: float, width: float) -> float:
    """-log2 of the mass between latent - 1/2 and latent + 1/2; 2^-24 more, as a coder gives everything."""
    x = wp.abs(latent)
    mass = 1.0 - tail(0.5 + x, width) - tail(0.5 - wp.min(x, 0.5), width)
    if x > 0.5:
        mass = tail(x - 0.5, width) - tail(x + 0.5, width)
    return -wp.log2(mass + wp.static(2.0**-24))


@wp.func
def width_of(parameter: float) -> float:
    """Softplus: positive."""
    return 0.02 + wp.log(1.0 + wp.exp(parameter))


@wp.kernel
def rate_kernel(
    read: wp.array[wp.vec4],
    channels: wp.array[int],
    widths: wp.array[wp.vec4],
    bits: wp.array[float],
):
    """channels[i]: which four channels vector i is of."""
    i = wp.tid()
    width = widths[channels[i]]
    total = float(0.0)
    for c in range(4):
        total += bits_of(read[i][c], width_of(width[c]))
    bits[i] = total


class Rate:
    """The second part of the loss, for `train`."""

    def __init__(self, texture: Texture, weight: float):
        self.texture, device, count = texture, texture.device, sum(texture.vectors)
        self.channels = wp.array(channels_of(texture), dtype=int, device=device)
        self.parameters = Parameters(widths=wp.zeros(texture.spec.n_in // 4, dtype=wp.vec4, device=device))
        self.widths = self.parameters["widths"]
        self.optimizer = Adam(self.parameters, lr=0.02, beta2=0.99, clear=True)
        self.bits = wp.zeros(count, dtype=float, device=device)
        weight /= np.prod(texture.target.size)
        self.weight = wp.full(count, value=weight, dtype=float, device=device)  # d loss / d bits

    def add_gradient(self, _: wp.array) -> None:
        read, device = self.texture.read, self.texture.device
        wp.launch(
            rate_kernel, read.shape, inputs=[read, self.channels, self.widths], outputs=[self.bits], adjoint=True,
            adj_inputs=[read.grad, None, self.widths.grad], adj_outputs=[self.weight], device=device,
        )  # fmt: skip
        self.optimizer.step()

    def bits_of_latents(self) -> float:
        """Of all, rounded as they were last read, and of their widths."""
        read, device = self.texture.read, self.texture.device
        wp.launch(rate_kernel, read.shape, [read, self.channels, self.widths], [self.bits], device=device)
        return float(self.bits.numpy().sum(dtype=np.float64)) + 16 * 4 * self.widths.size


def channels_of(texture: Texture) -> np.ndarray:
    """Of each vector of latents, counted over the grids."""
    parts, first = [], 0
    for grid, count in zip(texture.spec.grids, texture.vectors, strict=True):
        parts.append(first + np.arange(count) % (grid.channels // 4))
        first += grid.channels // 4
    return np.concatenate(parts)


def trained(config: Config, name: str, target: TextureSet, weight: float) -> tuple[Texture, Rate]:
    texture = Texture(GRIDS, target, config.seed, cli.resolve_device(config.device))
    rate, finish = Rate(texture, weight), int(FINISH * config.effort(texture.device)[0])

    def see(steps: wp.array) -> None:
        inputs = [texture.latents, texture.read, LIMIT, config.seed, steps, finish]
        wp.launch(finish_kernel, texture.latents.shape, inputs=inputs, device=texture.device)

    train(config, f"{name}, {weight:g}", texture, see, rate.add_gradient)
    see(wp.full(1, value=finish, dtype=int, device=texture.device))
    return texture, rate


def all_trained(config: Config, name: str, target: TextureSet) -> dict[float, tuple[Texture, Rate]]:
    return {weight: trained(config, name, target, weight) for weight in RATE_WEIGHTS}


def points_of(found: dict[float, tuple[Texture, Rate]]) -> list[Point]:
    return [
        texture.point(texture.whole(), rate.bits_of_latents(), rate_weight=weight)
        for weight, (texture, rate) in found.items()
    ]


def curve(config: Config, target: TextureSet) -> list[Point]:
    return points_of(all_trained(config, "step_06", target))


def main(config: Config) -> dict:
    return report(config, "step_06", curve)


if __name__ == "__main__":
    cli.run(main, Config)
