"""neural texture 2: a second, coarser grid. Leaves step_02.png.

    python -m samples.neural_texture.step_02_several_grids [--material FOLDER]

Cells of 8 x 8 texels see further than those of 2 x 2 and cost a sixteenth for each number: eight more numbers, for what
changes slowly, are an eighth more latents. So the fine grid's are left for what is fine.
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
