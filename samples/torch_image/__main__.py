"""A picture learned in a PyTorch loop, by tiny-cuda-nn's `mlp_learning_an_image` and its configuration files.

    python -m samples.torch_image [--image FILE] [--config config_hash.json]

A hash grid and two layers of 64 neurons learn uv -> colour from random points with bilinear colours; the loop is that
of any PyTorch model. Leaves picture.png, the target on the left. On the photograph that scikit-image
carries, 512 x 512, 500 steps of 4,096 samples reach 31.0 dB as 8-bit sRGB, in 40 seconds on one CPU core.
"""

import json
import time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
from skimage import data

from warp_neural import cli
from warp_neural.cli import CommonConfig, Count, Samples
from warp_neural.errors import InputError
from warp_neural.imaging.image import displayed_psnr, load_image, srgb_to_linear
from warp_neural.samples.network.target import save_beside, srgb_codes

# what tiny-cuda-nn's example takes by itself
DEFAULT = {
    "loss": {"otype": "RelativeL2"},
    "optimizer": {"otype": "Adam", "learning_rate": 1e-2, "beta1": 0.9, "beta2": 0.99, "epsilon": 1e-15},
    "encoding": {"otype": "HashGrid", "log2_hashmap_size": 15, "per_level_scale": 1.5},
    "network": {"otype": "FullyFusedMLP", "n_neurons": 64, "n_hidden_layers": 2},
}


@dataclass(frozen=True, kw_only=True)
class Config(CommonConfig):
    out: Path = Path("out/torch_image")
    """folder for the picture"""
    image: Path | None = None
    """picture to learn; none: NASA's photograph of Eileen Collins, which scikit-image carries"""
    config: Path | None = None
    """tiny-cuda-nn's JSON file with loss, optimizer, encoding and network; none: a hash grid and 2 x 64 neurons"""
    steps: Count = 500
    """gradient steps"""
    batch: Samples = 1 << 12
    """samples a step"""


def load_config(path: Path | None) -> dict:
    if path is None:
        return DEFAULT
    try:
        found = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}; give a JSON file of tiny-cuda-nn") from error
    if not isinstance(found, dict) or not DEFAULT.keys() <= found.keys():
        raise InputError(f"{path}: not an object with {', '.join(DEFAULT)}; give a JSON file of tiny-cuda-nn")
    return found


def load_target(config: Config) -> np.ndarray:
    """Linear float32 [height, width, 3]."""
    if config.image is None:
        return srgb_to_linear(data.astronaut() / 255).astype(np.float32)
    image = load_image(config.image)
    return np.repeat(image, 3, axis=-1) if image.shape[-1] == 1 else np.ascontiguousarray(image[..., :3])


def main(config: Config) -> dict:
    try:
        import_module("warp_neural.torch")  # which says what to install
        from warp_neural.samples.torch_image.learn import learn
    except ModuleNotFoundError as error:
        raise InputError(str(error)) from error
    target = load_target(config)
    began = time.perf_counter()
    picture, n_parameters = learn(config, load_config(config.config), target)
    seconds = time.perf_counter() - began
    save_beside(config.out / "picture.png", target, picture)
    psnr = displayed_psnr(srgb_codes(target) / 255, srgb_codes(picture) / 255)
    return {"psnr": psnr, "parameters": n_parameters, "steps": config.steps, "seconds": seconds}


if __name__ == "__main__":
    cli.run(main, Config)
