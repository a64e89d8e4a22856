"""neural texture 3: weights of the four cells that are trained. Leaves step_03.png.

    python -m samples.neural_texture.step_03_learned_kernels [--material FOLDER]

A texel at one place of a cell need not read what bilinear interpolation says: each channel of latents has, for each of
the 4 or 64 places, four weights of its own, which begin there and then learn. So detail finer than a cell can stand in
the kernels, which all cells share, and a latent says how much of it is here. Latents take the same bits, the kernels
add a third of a bit a texel. The loss is computed as before, its weights become an optimizer's (`train` in step 1).
Expect 1.4 dB more at equal bits from 6 bits a texel on, 1.1 at 5, 0.4 at 4.
"""

from warp_neural import cli
from warp_neural.kernels.texture.spec import Grid
from warp_neural.samples.neural_texture.step_01_latent_texture import fit
from warp_neural.samples.neural_texture.target import Config, report
from warp_neural.samples.neural_texture.texture import Point
from warp_neural.texture.maps import TextureSet

GRIDS = Grid(2, 4, "learned"), Grid(8, 12, "learned")


def curve(config: Config, target: TextureSet) -> list[Point]:
    return fit(config, "step_03", target, GRIDS)


def main(config: Config) -> dict:
    return report(config, "step_03", curve)


if __name__ == "__main__":
    cli.run(main, Config)
