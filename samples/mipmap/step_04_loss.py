"""mipmap 4: the loss, squared difference of step 2 to step 3, a figure for each texel. Leaves step_04.png.

    python -m samples.mipmap.step_04_loss

Bright where filtered maps fail: on the glossy parts, hardly on the rough ones. Expect a mean loss of 0.84.
"""

import numpy as np
import warp as wp

from warp_neural import cli
from warp_neural.samples.figures import save_picture
from warp_neural.samples.mipmap.maps import MaterialConfig, source_maps
from warp_neural.samples.mipmap.step_01_basic_program import render, shown, upload
from warp_neural.samples.mipmap.step_02_downsampled_inputs import downsampled, enlarge


@wp.kernel(enable_backward=False)
def loss_kernel(color: wp.array2d[wp.vec3], reference: wp.array2d[wp.vec3], loss: wp.array2d[float]):
    i, j = wp.tid()
    error = color[i, j] - reference[i, j]
    loss[i, j] = wp.dot(error, error)  # summed over RGB, as in the course


def main(config: MaterialConfig) -> dict:
    device = cli.resolve_device(config.device)
    _name, maps = source_maps(config, device)
    textures = upload(maps, device)
    small = render([downsampled(texture, config.factor) for texture in textures])
    reference = downsampled(render(textures), config.factor)

    loss = wp.empty(small.shape, dtype=float, device=device)
    wp.launch(loss_kernel, dim=loss.shape, inputs=[small, reference], outputs=[loss], device=device)

    grey = np.minimum(loss.numpy(), 1.0)[..., None].repeat(3, axis=-1)
    row = [shown(reference), shown(small), grey]
    save_picture(config.out / "step_04.png", np.concatenate([enlarge(p, config.factor) for p in row], axis=1))
    return {"loss": float(loss.numpy().mean()), "resolution": list(loss.shape)}


if __name__ == "__main__":
    cli.run(main, MaterialConfig)
