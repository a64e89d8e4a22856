"""neural texture 4: latents that bear being rounded. Leaves step_04.png.

    python -m samples.neural_texture.step_04_noise [--material FOLDER]

Rounding to whole numbers adds an error that is about uniform between -1/2 and 1/2 (Balle et al. 2017, "End-to-end
optimized image compression", 3.1). Training with such noise on every latent, new in each step, the same for all texels
that read it, makes latents so large that it matters little, and no larger, since bits leave only so many whole numbers.
For each number of bits a training of its own. The gradient of what is read is that of the latent: adding has slope 1.
Expect 0.9 dB more at 3 bits a latent, 0.25 at 4.
"""

import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.neural_texture.step_01_latent_texture import train
from warp_neural.samples.neural_texture.step_03_learned_kernels import GRIDS
from warp_neural.samples.neural_texture.target import Config, report
from warp_neural.samples.neural_texture.texture import Point, Texture
from warp_neural.texture.maps import TextureSet

BITS = 4, 3, 2  # of a latent
NOISE = wp.constant(1)  # purpose of these random numbers: others than those that choose texels


@wp.func
def noisy(latents: wp.vec4, i: int, seed: wp.uint64, step: int) -> wp.vec4:
    return latents + wn.random.uniform(wn.random.stream(seed, step, i, NOISE), 0) - wp.vec4(0.5)


@wp.func
def limited(latents: wp.vec4, limit: float) -> wp.vec4:
    """What rounds to whole numbers up to `limit`."""
    return wp.min(wp.max(latents, wp.vec4(-limit - 0.45)), wp.vec4(limit + 0.45))


@wp.kernel(enable_backward=False)
def noise_kernel(
    latents: wp.array[wp.vec4], read: wp.array[wp.vec4], limit: float, seed: wp.uint64, steps: wp.array[int]
):
    i = wp.tid()
    latents[i] = limited(latents[i], limit)
    read[i] = noisy(latents[i], i, seed, steps[0])


def fit(config: Config, name: str, target: TextureSet, kernel: wp.Kernel, *finish: int) -> list[Point]:
    """A training for each of `BITS`. kernel: from latents to what the network sees of them. finish: for it."""
    points = []
    for bits in BITS:
        texture = Texture(GRIDS, target, config.seed, cli.resolve_device(config.device))

        def see(steps: wp.array, texture: Texture = texture, limit: int = 2 ** (bits - 1) - 1) -> None:
            inputs = [texture.latents, texture.read, limit, config.seed, steps, *finish]
            wp.launch(kernel, texture.latents.shape, inputs=inputs, device=texture.device)

        train(config, f"{name}, {bits} bits", texture, see)
        points.append(texture.point(texture.whole(), 4 * sum(texture.vectors) * bits, bits_of_latent=bits))
    return points


def curve(config: Config, target: TextureSet) -> list[Point]:
    return fit(config, "step_04", target, noise_kernel)


def main(config: Config) -> dict:
    return report(config, "step_04", curve)


if __name__ == "__main__":
    cli.run(main, Config)
