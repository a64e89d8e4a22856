"""The main job: all five steps, then the lecture's 'adding more parameters', on one sheet with their quality and time.

    python -m samples.network [--image FILE] [--steps 2000]

More parameters alone, step 3's network with layers of 3 x 32, 3 x 64 and 4 x 64 neurons, buy less than a better input:
step 4 with 1,699 parameters beats 4 x 64 with 12,867. PSNR is that of the whole picture as 8-bit sRGB; seconds are of
training, without the compiler's. slangstars.png of the course, 256 x 256, 2,000 steps of 4,096 samples on one CPU core:

    step            1      2      3      4      5     3x32   3x64   4x64
    parameters      9   1251   1251   1699   5411     2307   8707  12867
    PSNR, dB     12.0   17.0   18.5   29.4   36.9     21.1   22.1   24.1
    seconds       0.9    1.5    1.7    1.6    1.8      2.4    6.1    8.1

There step 2 loses to step 3 with each of the seeds 0 to 7, by 1.8 dB in the mean, most of it where outputs died: begun
from grey, as step 1, it reaches 17.9 dB. On photographs, which fill these networks with detail, either of
the two may end ahead, mostly within 0.3 dB, by seed up to 2 dB; steps 4 and 5 are each far ahead of the one before on
all pictures tried.
"""

import json
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

import warp_neural as wn
from warp_neural import cli
from warp_neural.io.files import atomic_path
from warp_neural.samples.figures import save_figure, show
from warp_neural.samples.network import (
    step_01_basic_network,
    step_02_multiple_layers,
    step_03_activations,
    step_04_frequency_encoding,
    step_05_latent_texture,
)
from warp_neural.samples.network.step_01_basic_network import fit
from warp_neural.samples.network.target import Config, load_target, srgb_codes


def make_larger(width: int, depth: int, **options) -> wn.MLP:
    """Step 3's network with other sizes."""
    inside, outside = wn.activations.leaky_relu, wn.activations.exponential
    return wn.MLP(2, 3, width, depth, activation=inside, output_activation=outside, **options)


NETWORKS: dict[str, tuple[str, Callable[..., wn.MLP]]] = {
    "step_01": ("2-3, ReLU", step_01_basic_network.make_network),
    "step_02": ("2-32-32-3, ReLU", step_02_multiple_layers.make_network),
    "step_03": ("leaky ReLU, exponential", step_03_activations.make_network),
    "step_04": ("frequency encoding", step_04_frequency_encoding.make_network),
    "step_05": ("latent texture", step_05_latent_texture.make_network),
    "3x32": ("step 3 with 3 x 32", partial(make_larger, 32, 3)),
    "3x64": ("step 3 with 3 x 64", partial(make_larger, 64, 3)),
    "4x64": ("step 3 with 4 x 64", partial(make_larger, 64, 4)),
}


def main(config: Config) -> dict:
    began = time.perf_counter()
    target = load_target(config)
    with atomic_path(config.out / "config.json") as path:  # a folder that cannot be written fails now
        path.write_text(json.dumps(asdict(config), indent=2, default=str) + "\n")
    pictures, metrics = {}, {}
    for name in cli.progress(NETWORKS, config, desc="networks"):
        pictures[name], measured = fit(config, name, NETWORKS[name][1], target)
        metrics |= measured
    save_sheet(config.out / "comparison.png", target, pictures, metrics)
    device = cli.resolve_device(config.device)
    metrics |= {"steps": config.steps, "resolution": list(target.shape[:2])}
    metrics |= {"device": device.name if device.is_cuda else "cpu", "seconds_total": time.perf_counter() - began}
    return metrics


def save_sheet(path: Path, target: np.ndarray, pictures: dict[str, np.ndarray], metrics: dict) -> None:
    """The target and what each network made of it."""
    from matplotlib.figure import Figure

    height, width = target.shape[:2]
    figure = Figure(figsize=(10.5, 3 * (3.3 * height / width + 0.55)), layout="constrained")
    titles = {name: title(name, metrics) for name in pictures}
    shown = {"target": target, **pictures}
    for axis, name in zip(figure.subplots(3, 3).flat, shown, strict=True):
        show(axis, srgb_codes(shown[name]) / 255, titles.get(name, f"target\n{width} x {height}"))
    save_figure(path, figure)


def title(name: str, metrics: dict) -> str:
    about = NETWORKS[name][0] if not name.startswith("step") else f"step {name[-1]}: {NETWORKS[name][0]}"
    psnr, parameters, seconds = (metrics[f"{key}_{name}"] for key in ("psnr", "parameters", "seconds"))
    return f"{about}\n{parameters:,} parameters, {psnr:.1f} dB, {seconds:.1f} s"


if __name__ == "__main__":
    cli.run(main, Config)
