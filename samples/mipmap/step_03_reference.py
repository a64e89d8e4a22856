"""mipmap 3: the reference. Shade in full resolution, then average the RESULT. Leaves step_03.png, step 2's beside it.

    python -m samples.mipmap.step_03_reference

This is what a viewer sees who stands too far away to tell the texels apart, so it is what every small map should look
like. It costs 16 evaluations a texel where step 2 costs one. Expect step 1's mean radiance of 0.158.
"""

import numpy as np

from warp_neural import cli
from warp_neural.samples.figures import save_picture
from warp_neural.samples.mipmap.maps import MaterialConfig, source_maps
from warp_neural.samples.mipmap.step_01_basic_program import render, shown, upload
from warp_neural.samples.mipmap.step_02_downsampled_inputs import downsampled, enlarge


def main(config: MaterialConfig) -> dict:
    device = cli.resolve_device(config.device)
    _name, maps = source_maps(config, device)
    textures = upload(maps, device)

    small = render([downsampled(texture, config.factor) for texture in textures])  # step 2: average, then shade
    reference = downsampled(render(textures), config.factor)  # shade, then average

    pair = [enlarge(shown(picture), config.factor) for picture in (reference, small)]
    save_picture(config.out / "step_03.png", np.concatenate(pair, axis=1))
    return {
        "mean_radiance_reference": float(reference.numpy().mean()),
        "mean_radiance_small": float(small.numpy().mean()),
        "resolution": list(reference.shape),
    }


if __name__ == "__main__":
    cli.run(main, MaterialConfig)
