"""mipmap 2: shade from box-filtered maps, as a texture unit would. Leaves step_02.png, step 1's picture beside it.

    python -m samples.mipmap.step_02_downsampled_inputs

Wrong, and it is the highlights: the averaged normals are nearly flat, so what glittered in many places from many
directions now shines in few. Only the mean is right: expect 0.159, and 0.158 in step 1.
"""

import numpy as np
import warp as wp

from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.materials.shading import downsample
from warp_neural.samples.figures import save_picture
from warp_neural.samples.mipmap.maps import MaterialConfig, source_maps
from warp_neural.samples.mipmap.step_01_basic_program import render, shown, upload


def halvings(factor: int) -> int:
    """How many 2 x 2 averages make `factor`."""
    if factor & (factor - 1):
        raise InputError(f"--factor {factor}: this step halves; choose a power of two")
    return factor.bit_length() - 1


def downsampled(image: wp.array, factor: int) -> wp.array:
    """2 x 2 averages until `factor` is reached."""
    for _ in range(halvings(factor)):
        image = downsample(image)
    return image


def enlarge(picture: np.ndarray, factor: int) -> np.ndarray:
    """Texels as squares, `[height, width, 3]` to `factor` times each side."""
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def main(config: MaterialConfig) -> dict:
    device = cli.resolve_device(config.device)
    _name, maps = source_maps(config, device)
    textures = upload(maps, device)

    full = render(textures)
    small = render([downsampled(texture, config.factor) for texture in textures])  # the line being taught

    pair = [shown(full), enlarge(shown(small), config.factor)]
    save_picture(config.out / "step_02.png", np.concatenate(pair, axis=1))
    return {
        "mean_radiance_full": float(full.numpy().mean()),
        "mean_radiance_small": float(small.numpy().mean()),
        "resolution": list(small.shape),
    }


if __name__ == "__main__":
    cli.run(main, MaterialConfig)
