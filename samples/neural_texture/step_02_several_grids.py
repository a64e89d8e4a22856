"""neural texture 2: a second, coarser grid. Leaves step_02.png.

    python -m samples.neural_texture.step_02_several_grids [--material FOLDER]

Cells of 8 x 8 texels see further than those of 2 x 2 and cost a sixteenth for each number: twelve more numbers, for
what changes slowly, are 3/16 more latents. So the fine grid's are left for what is fine (as in Mueller et al. 2022,
"Instant neural graphics primitives", and in Vaidyanathan et al. 2023, "Random-access neural compression of material
textures"). Expect 0.6 dB more at equal bits from 6 bits a texel on, 0.3 at 5; 0.15 less at 3.8, where latents have 3.
"""

from warp_neural import cli
from warp_neural.kernels.texture.spec import Grid
from warp_neural.samples.neural_texture.step_01_latent_texture import fit
from warp_neural.samples.neural_texture.target import Config, report
from warp_neural.samples.neural_texture.texture import Point
from warp_neural.texture.maps import TextureSet

GRIDS = Grid(2, 4, "bilinear"), Grid(8, 12, "bilinear")


def curve(config: Config, target: TextureSet) -> list[Point]:
    return fit(config, "step_02", target, GRIDS)


def main(config: Config) -> dict:
    return report(config, "step_02", curve)


if __name__ == "__main__":
    cli.run(main, Config)
