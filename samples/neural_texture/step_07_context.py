"""neural texture 7: contexts, and a file. Leaves step_07.png and step_07_WEIGHT.wntc.

    python -m samples.neural_texture.step_07_context [--material FOLDER]

Step 6's latents again, in fewer bits. A decoder knows what it has decoded: where the latents to the left and above are
large, the next one is likely to be, and a wider distribution fits it (Weinberger et al. 2000, "The LOCO-I lossless
image compression algorithm", section 2). Here a width is a trained sum of these two magnitudes, which saves 1 to 2 %.
The codec's file sees more neighbours, earlier channels and the coarser grid, and expects means too (docs/wntc.md), 5 to
7 %: `save_state` fits its contexts and codes. Bits are those of the whole file, PSNR is that of what `wn.texture.load`
reads back from it.
"""

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.neural_texture.step_06_rate import Rate, all_trained, bits_of, width_of
from warp_neural.samples.neural_texture.target import Config, report
from warp_neural.samples.neural_texture.texture import Point, Texture
from warp_neural.texture.file import save_state
from warp_neural.texture.maps import TextureSet
from warp_neural.texture.measure import psnr
from warp_neural.train.optim import Adam, Parameters

STEPS = 150  # of fitting two neighbours' weights


@wp.kernel
def context_kernel(latents: wp.array3d[float], weights: wp.array2d[float], bits: wp.array3d[float]):
    """weights: of each channel; 0 of the width without neighbours, 1 of the left one, 2 of the one above."""
    i, j, c = wp.tid()
    left, above = float(0.0), float(0.0)
    if j > 0:
        left = wp.abs(latents[i, j - 1, c])
    if i > 0:
        above = wp.abs(latents[i - 1, j, c])
    width = width_of(weights[0, c]) + width_of(weights[1, c]) * left + width_of(weights[2, c]) * above
    bits[i, j, c] = bits_of(latents[i, j, c], width)


def bits_by_neighbours(texture: Texture) -> float:
    """Of all rounded latents under contexts fitted to them, and 16 for each weight."""
    total = 0.0
    for grid in texture.grids():
        latents = wp.array(np.rint(grid), dtype=float, device=texture.device)
        start = np.repeat([[0.0], [-3.0], [-3.0]], grid.shape[2], axis=1)
        weights = Parameters(weights=wp.array(start, dtype=float, device=texture.device))
        optimizer, bits = Adam(weights, lr=0.05, clear=True), wp.zeros_like(latents)
        mean = wp.full(latents.shape, value=1.0 / latents.size, dtype=float, device=texture.device)
        inputs = [latents, weights["weights"]]
        gradients = [None, weights["weights"].grad]
        for _ in range(STEPS):
            wp.launch(
                context_kernel, latents.shape, inputs=inputs, outputs=[bits], adjoint=True,
                adj_inputs=gradients, adj_outputs=[mean], device=texture.device,
            )  # fmt: skip
            optimizer.step()
        wp.launch(context_kernel, latents.shape, inputs=inputs, outputs=[bits], device=texture.device)
        total += float(bits.numpy().sum(dtype=np.float64)) + 16 * start.size
    return total


def points_of(config: Config, found: dict[float, tuple[Texture, Rate]]) -> list[Point]:
    points = []
    for weight, (texture, rate) in found.items():
        path, texels = config.out / f"step_07_{weight:g}.wntc", np.prod(texture.target.size)
        size = save_state(path, texture.whole())
        values = wn.texture.load(path, texture.device).decoder.decode()
        about = {"rate_weight": weight, "latents_alone": rate.bits_of_latents() / texels}
        about |= {"latents_by_neighbours": bits_by_neighbours(texture) / texels}
        about |= {"latents_in_file": 8 * (size["contexts"] + np.sum(size["latents"])) / texels}
        points.append(Point(float(8 * size["all"] / texels), psnr(texture.target.values, values), values, about))
    return points


def curve(config: Config, target: TextureSet) -> list[Point]:
    return points_of(config, all_trained(config, "step_07", target))


def main(config: Config) -> dict:
    return report(config, "step_07", curve)


if __name__ == "__main__":
    cli.run(main, Config)
