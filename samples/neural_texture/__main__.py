"""The main job: seven steps from a latent texture to the codec, each one idea, and what each gains on one curve.

    python -m samples.neural_texture [--material FOLDER] [--side 256]

Leaves curves.png, crops.png, metrics.json and the files of step 7 and of the codec. Bits a texel count all that a
decoder needs, weights too; PSNR is that of all channels as 8 bits. Gains are over the step before, the mean over the
logarithms of the bits that both curves have. The default material, 256 x 256 texels of nine channels, on two CPU cores,
in three and a half minutes, half of them the codec's:

    step                     bits, dB near 4 bits     gain, dB
    1 one bilinear grid      4.17  30.6
    2 several grids          3.77  30.0               +0.31
    3 learned kernels        4.10  30.8               +1.13
    4 noise                  4.11  31.7               +0.56
    5 straight through       4.11  31.9               +0.44
    6 rate term              3.96  32.2               +0.68
    7 contexts, a file       3.77  32.2               +0.21
    the codec                3.67  32.0               -0.08

Gains differ along the curves: several grids pay from 4 bits a latent on, and cost 0.15 dB at 3; noise, finish and rate
term pay the more the fewer bits there are, about 1 dB each near 3 bits a texel, 0.1 to 0.3 at 5. With another seed no
gain changes by more than 0.1 dB. The codec is no further here: its network and kernels take 1.02 of its 3.67 bits of so
small a picture, step 7's half a bit; and on the CPU this is its short run.
"""

import json
import time
from dataclasses import asdict
from itertools import pairwise

import numpy as np

import warp_neural as wn
from warp_neural import cli
from warp_neural.io.files import atomic_path
from warp_neural.samples.neural_texture import (
    step_01_latent_texture,
    step_02_several_grids,
    step_03_learned_kernels,
    step_04_noise,
    step_05_straight_through,
    step_06_rate,
    step_07_context,
)
from warp_neural.samples.neural_texture.figures import gain, save_crops, save_curves
from warp_neural.samples.neural_texture.target import Config, load_target
from warp_neural.samples.neural_texture.texture import Point
from warp_neural.texture.maps import TextureSet

QUALITY = "medium"  # of the codec: a rate weight of 3e-4, the middle one of step 6
STEPS_ON_CPU = 5_000  # of the codec
STEPS = {
    "step_01": step_01_latent_texture,
    "step_02": step_02_several_grids,
    "step_03": step_03_learned_kernels,
    "step_04": step_04_noise,
    "step_05": step_05_straight_through,
}
IDEAS = {
    "step_01": "1 one bilinear grid",
    "step_02": "2 several grids",
    "step_03": "3 learned kernels",
    "step_04": "4 noise",
    "step_05": "5 straight through",
    "step_06": "6 rate term",
    "step_07": "7 contexts, a file",
    "codec": "the codec",
}


def codec(config: Config, target: TextureSet) -> list[Point]:
    """The product on the same picture; on the CPU in a shorter run."""
    device = cli.resolve_device(config.device)
    steps = None if device.is_cuda else STEPS_ON_CPU
    options = {"steps": steps, "device": device, "seed": config.seed, "quiet": config.json}
    texture = wn.texture.compress(target, quality=QUALITY, **options)
    size = texture.save(config.out / "codec.wntc")
    bits = 8 * size["all"] / np.prod(target.size)
    return [Point(float(bits), texture.metrics["psnr"], texture.decoder.decode(), {})]


def main(config: Config) -> dict:
    began = time.perf_counter()
    target = load_target(config)
    with atomic_path(config.out / "config.json") as path:  # a folder that cannot be written fails now
        path.write_text(json.dumps(asdict(config), indent=2, default=str) + "\n")
    curves = {name: step.curve(config, target) for name, step in STEPS.items()}
    trained = step_06_rate.all_trained(config, "step_06", target)
    curves["step_06"] = step_06_rate.points_of(trained)
    curves["step_07"] = step_07_context.points_of(config, trained)
    curves["codec"] = codec(config, target)
    gains = {after: gain(curves[before], curves[after]) for before, after in pairwise(curves)}
    save_curves(config.out / "curves.png", curves, gains, IDEAS)
    save_crops(config.out / "crops.png", target, curves, IDEAS)
    points = [(IDEAS[name], point) for name in curves for point in curves[name]]
    rows = [{"step": idea, "bits": point.bits, "psnr": point.psnr} for idea, point in points]
    device = cli.resolve_device(config.device)
    metrics = {"points": rows} | {f"gain_{name}": value for name, value in gains.items()}
    metrics |= {"resolution": list(target.size), "channels": target.channels}
    metrics |= {"device": device.name if device.is_cuda else "cpu", "seconds_total": time.perf_counter() - began}
    with atomic_path(config.out / "metrics.json") as path:
        path.write_text(json.dumps(metrics, indent=2) + "\n")
    return metrics


if __name__ == "__main__":
    cli.run(main, Config)
