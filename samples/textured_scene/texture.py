"""What the steps share and do not teach: options, and the neural texture, from a file or trained on the spot."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.cli import Between, CommonConfig
from warp_neural.errors import InputError
from warp_neural.samples.textured_scene.fetch import CHANNELS, MAPS
from warp_neural.samples.textured_scene.material import tiled_material
from warp_neural.texture.maps import load_set
from warp_neural.texture.texture import Texture

TEXELS = 256  # a side of the material on the CPU; twice as many on CUDA
STEPS_ON_CPU = 1000


@dataclass(frozen=True, kw_only=True)
class Config(CommonConfig):
    """The options of every step."""

    out: Path = Path("out/textured_scene")
    """folder for pictures and files"""
    texture: Path | None = None
    """a .wntc file, or .safetensors for engines, of albedo, normal and roughness with all their channels; none: tiles,
    trained first for few bits in memory"""
    steps: Annotated[int | None, Between(100, 10**7)] = None
    """gradient steps of that training; none: 1000 on the CPU, those of a preview on CUDA"""
    width: Annotated[int | None, Between(16, 4096)] = None
    """pixels of the picture, whose height is two thirds of it; none: 360 on the CPU, 1080 on CUDA"""

    @property
    def size(self) -> tuple[int, int]:
        """(height, width)."""
        width = self.width or (1080 if cli.resolve_device(self.device).is_cuda else 360)
        return width * 2 // 3, width


def load_texture(config: Config, device: wp.Device) -> Texture:
    """With channels in the order that `scene.py` wants. Raises `InputError` for a file that has others."""
    if config.texture:
        texture = wn.texture.load(config.texture, device)
        wanted = dict(zip(MAPS, ((0, 1, 2), (3, 4, 5), (6,)), strict=True))
        if texture.channels != wanted:
            raise InputError(f"{config.texture}: give a texture of albedo, normal and roughness, {CHANNELS} channels")
        return texture
    side, steps = (2 * TEXELS, config.steps) if device.is_cuda else (TEXELS, config.steps or STEPS_ON_CPU)
    source = load_set(tiled_material(side, config.seed), maps=MAPS)
    options = {"device": device, "seed": config.seed, "quiet": config.json, "preview": device.is_cuda}
    texture = wn.texture.compress(source, mips=side.bit_length(), steps=steps, storage="sample", **options)
    texture.save(config.out / "tiles.wntc")
    return texture
