"""The options that say how a sphere looks."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp

from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.samples.shader_training.spheres import Surface


@dataclass(frozen=True, kw_only=True)
class LookConfig(cli.CommonConfig):
    """How the sphere looks."""

    out: Path = Path("out/shader_training")
    """folder for pictures and files"""
    network: Path | None = None
    """network to show instead of training one: .safetensors, or RTXNS's .bin or .json"""
    base_color: tuple[float, float, float] = (0.55, 0.12, 0.05)
    """linear RGB [0, 1]"""
    specular: float = 0.5
    """reflection at normal incidence, 1 is 8 percent [0, 1]"""
    roughness: float = 0.35
    """[0.3, 1], what the network has seen"""
    metallic: float = 0.2
    """[0, 1]"""
    light: tuple[float, float, float] = (0.6, 0.6, 0.6)
    """towards the light: x right, y up, z to the viewer"""
    intensity: float = 3.0
    """of the light"""
    size: int = 384
    """pixels along a side of the picture"""


def check(config: LookConfig) -> None:
    for option in ("specular", "metallic"):
        if not 0 <= getattr(config, option) <= 1:
            raise InputError(f"--{option} {getattr(config, option)}: give 0 to 1")
    if not all(0 <= c <= 1 for c in config.base_color):
        raise InputError(f"--base-color {config.base_color}: give three numbers from 0 to 1")
    if not 0.3 <= config.roughness <= 1:
        raise InputError(f"--roughness {config.roughness}: give 0.3 to 1, what the network has seen")
    if not 0 < np.linalg.norm(config.light) < np.inf:
        raise InputError(f"--light {config.light}: give a direction that is not zero")
    for option in ("epochs", "batch", "rate", "samples", "gain", "size", "intensity"):
        value = getattr(config, option, None)
        if value is not None and not 0 < value < np.inf:
            raise InputError(f"--{option} {value}: give a positive number")


def surface_of(config: LookConfig) -> Surface:
    surface = Surface()
    surface.base_color = wp.vec3(*config.base_color)
    surface.specular, surface.metallic, surface.intensity = config.specular, config.metallic, config.intensity
    return surface


def light_of(config: LookConfig) -> np.ndarray:
    """Unit vector [3]."""
    return np.array(config.light, np.float64) / np.linalg.norm(config.light)
