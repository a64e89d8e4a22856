"""The options that say how a sphere looks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import warp as wp

from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.samples.shader_training.spheres import Surface

SHARE = cli.Between(0, 1)


@dataclass(frozen=True, kw_only=True)
class LookConfig(cli.TrainingConfig):
    """How the sphere looks."""

    out: Path = Path("out/shader_training")
    """folder for pictures and files"""
    network: Path | None = None
    """network to show instead of training one: .safetensors, or RTXNS's .bin or .json"""
    base_color: Annotated[tuple[float, float, float], SHARE] = (0.55, 0.12, 0.05)
    """linear RGB [0, 1]"""
    specular: Annotated[float, SHARE] = 0.5
    """reflection at normal incidence, 1 is 8 percent [0, 1]"""
    roughness: Annotated[float, cli.Between(0.3, 1)] = 0.35
    """[0.3, 1], what the network has seen"""
    metallic: Annotated[float, SHARE] = 0.2
    """[0, 1]"""
    light: Annotated[tuple[float, float, float], cli.Between(-1e6, 1e6)] = (0.6, 0.6, 0.6)
    """towards the light: x right, y up, z to the viewer"""
    intensity: cli.Positive = 3.0
    """of the light"""
    size: cli.Side = 384
    """pixels along a side of the picture"""


def check(config: LookConfig) -> None:
    if not any(config.light):
        raise InputError("--light 0 0 0: give a direction that is not zero")


def surface_of(config: LookConfig) -> Surface:
    surface = Surface()
    surface.base_color = wp.vec3(*config.base_color)
    surface.specular, surface.metallic, surface.intensity = config.specular, config.metallic, config.intensity
    return surface


def light_of(config: LookConfig) -> np.ndarray:
    """Unit vector [3]."""
    return np.array(config.light, np.float64) / np.linalg.norm(config.light)
