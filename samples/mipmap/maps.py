"""The maps of one mip level, and the options that choose the material they come from."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import warp as wp

from warp_neural.cli import CommonConfig
from warp_neural.default_material import default_material
from warp_neural.errors import InputError
from warp_neural.material import load_material


@dataclass(frozen=True, kw_only=True)
class MaterialConfig(CommonConfig):
    """Where the maps come from."""

    out: Path = Path("out/mipmap")
    """folder for pictures and files"""
    material: Path | None = None
    """folder with maps, e.g. ../shared/data/materials/PavingStones070; none: bricks made from two photographs"""
    roughness_scale: float = 0.4
    """wet it: factor on the roughness (0, 1]"""
    crop: int | None = None
    """side of the square that is cut out of the middle; none: 256 on the CPU, the whole material on CUDA"""
    factor: int = 4
    """texels of the source along one side of a learned texel"""


@dataclass(frozen=True)
class Maps:
    """What the shader reads, float32 on the host."""

    albedo: np.ndarray  # [height, width, 3], linear, in [0, 1]
    normal: np.ndarray  # [height, width, 3], unit length, z > 0
    roughness: np.ndarray  # [height, width], in [0, 1]
    metalness: np.ndarray  # [height, width], in [0, 1]
    specular: np.ndarray  # [height, width], in [0, 1]; 1 in a source

    @property
    def shape(self) -> tuple[int, int]:
        return self.roughness.shape

    def arrays(self) -> dict[str, np.ndarray]:
        return {field.name: getattr(self, field.name) for field in fields(self)}


def source_maps(config: MaterialConfig, device: wp.Device) -> tuple[str, Maps]:
    """The material's name and its maps in full resolution. Raises `InputError` for sizes that do not fit."""
    if not 0 < config.roughness_scale <= 1:
        raise InputError(f"--roughness-scale {config.roughness_scale}: choose one above 0, at most 1")
    if config.material is None:
        material = default_material(config.crop or (1024 if device.is_cuda else 256))
    else:
        material = load_material(config.material)
        crop = config.crop or (None if device.is_cuda else min(256, *material.resolution))
        material = material.crop(crop) if crop else material
    height, width = material.resolution
    if config.factor < 2 or height % config.factor or width % config.factor:
        multiple = min(height, width) // max(config.factor, 1) * config.factor
        raise InputError(
            f"--factor {config.factor}: does not divide {width} x {height}; choose a factor of 2 or more that does, "
            f"or --crop {multiple}"
        )
    roughness = material.roughness * np.float32(config.roughness_scale)
    specular = np.ones_like(roughness)
    return material.name, Maps(material.albedo, material.normal, roughness, material.metalness, specular)


def pack(maps: Maps, factor: int, device: wp.Device) -> wp.array:
    """Planes of vec4, `[2 factor^2, texels]`: a thread reads all that lies under its texel in whole, coalesced vec4s.

    Even planes hold albedo and roughness, odd ones normal x and y (z follows, it is positive), metalness, specular.
    """
    first = np.concatenate([maps.albedo, maps.roughness[..., None]], axis=-1)
    second = np.concatenate([maps.normal[..., :2], maps.metalness[..., None], maps.specular[..., None]], axis=-1)
    height, width = maps.shape
    both = np.stack([first, second], axis=2).astype(np.float32)  # [height, width, 2, 4]
    both = both.reshape(height // factor, factor, width // factor, factor, 2, 4).transpose(1, 3, 4, 0, 2, 5)
    return wp.array(both.reshape(2 * factor * factor, -1, 4), dtype=wp.vec4, device=device)


@wp.func
def unpack_normal(second: wp.vec4) -> wp.vec3:
    """The unit normal of an odd plane's texel."""
    x = second[0]
    y = second[1]
    return wp.vec3(x, y, wp.sqrt(wp.max(1.0 - x * x - y * y, 0.0)))
