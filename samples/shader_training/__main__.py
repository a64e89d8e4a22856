"""The main job: a network learns the Disney BRDF, as in RTXNS's "ShaderTraining", and lights a sphere with it.

    python -m samples.shader_training [--network FILE] [--base-color R G B] [--roughness 0.4] [--light X Y Z]

Five numbers go in, N.L, N.V, N.H, L.H and the roughness, six sines and cosines of each; four terms come out of three
layers of 32 neurons in float16. Leaves the network in three forms, the spheres and a sheet over roughness and light.
With `--network` nothing is trained: any 30-32-32-32-4 of RTXNS (.bin or .json) or of ours is measured and shown.
Expect a mean relative error of 0.46 % on the CPU, 0.31 % on an H200; the network that RTXNS ships has 0.54 %.

After 150,000 steps of 1,024 samples RTXNS's loss ends at 0.68 % with the cosine and 0.64 % with an exponential decay,
squared logarithms of ratios at 0.46 %, each term's smoothed relative error at 0.43 %, the loss of `loss.py` at 0.36 %.
Half the rate, or beta2 = 0.99, changes that little; neither does float16: the same weights in float32 err alike.
"""

import json
from dataclasses import dataclass
from typing import Annotated

import numpy as np

import warp_neural as wn
from warp_neural import cli
from warp_neural.io.files import atomic_path
from warp_neural.samples.shader_training.evaluate import evaluate
from warp_neural.samples.shader_training.figures import save_sheet, save_spheres
from warp_neural.samples.shader_training.look import LookConfig, check, light_of, surface_of
from warp_neural.samples.shader_training.spheres import render
from warp_neural.samples.shader_training.train import LOSS, RTXNS_LOSS, Recipe, load, make_net, save, train

ANGLES = np.linspace(0, 90, 6)  # degrees between light and view, of the sheet
ROUGHNESS = np.linspace(0.3, 1.0, 5)


@dataclass(frozen=True, kw_only=True)
class Config(LookConfig):
    epochs: Annotated[int | None, cli.Between(1, 10**5)] = None
    """of 100 steps each; none: 500 on the CPU, 1800 on CUDA"""
    batch: cli.Samples | None = None
    """samples of a step; none: 1024 on the CPU, 65,536 on CUDA"""
    rate: cli.Positive = 1e-2
    """Adam's learning rate at the start"""
    rtxns_loss: bool = False
    """train by RTXNS's loss, the weighted relative L2, and not by what is measured"""
    samples: cli.Samples = 1 << 20
    """held-out samples for the errors"""
    gain: cli.Positive = 50.0
    """factor on the difference in the pictures"""


def main(config: Config) -> dict:
    check(config)
    device = cli.resolve_device(config.device)
    seconds, trained = 0.0, 0
    if config.network:
        net = load(config.network, device)
    else:
        net = make_net(device, config.seed)
        defaults = Recipe(1800, 1 << 16) if device.is_cuda else Recipe(500, 1024)
        loss = RTXNS_LOSS if config.rtxns_loss else LOSS
        recipe = Recipe(config.epochs or defaults.epochs, config.batch or defaults.batch, config.rate, loss)
        seconds, trained = train(net, recipe, config), recipe.steps * recipe.batch
        save(config.out, net)
    metrics = evaluate(net, samples=config.samples, seed=config.seed)
    metrics |= {"samples": config.samples, "samples_train": trained, "seconds_train": seconds}
    metrics |= {"parameters": net.n_parameters, "device": device.name if device.is_cuda else "cpu"}
    metrics["psnr_sphere"] = draw_pictures(config, net, metrics["relative_error"])
    with atomic_path(config.out / "metrics.json") as path:
        path.write_text(json.dumps(metrics, indent=2) + "\n")
    return metrics


def draw_pictures(config: Config, net: wn.MLP, error: float) -> float:
    """spheres.png and sheet.png; the PSNR in dB of the neural sphere's displayed values."""
    surface, light = surface_of(config), light_of(config)
    analytic, neural = render(net, surface, np.array([config.roughness]), light[None], config.size)[:, 0]
    title = f"roughness {config.roughness:g}, metallic {config.metallic:g}; mean relative error {error:.2%}"
    save_spheres(config.out / "spheres.png", analytic, neural, config.gain, title)
    angles = np.radians(np.tile(ANGLES, len(ROUGHNESS)))
    lights = np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], axis=-1)
    pictures = render(net, surface, np.repeat(ROUGHNESS, len(ANGLES)), lights, max(config.size // 4, 1))
    pictures = pictures.reshape(2, len(ROUGHNESS), len(ANGLES), *pictures.shape[2:])
    save_sheet(config.out / "sheet.png", pictures, ROUGHNESS, ANGLES, config.gain)
    return float(-10 * np.log10(max(np.square(neural - analytic, dtype=np.float64).mean(), 1e-12)))


if __name__ == "__main__":
    cli.run(main, Config)
