"""The maps of one mip level, and the options that choose the material they come from."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import warp as wp

from warp_neural.cli import Between, CommonConfig
from warp_neural.coopvec import make_load
from warp_neural.errors import InputError
from warp_neural.materials.default_material import default_material
from warp_neural.materials.material import load_material
from warp_neural.materials.shading import brdf

Channels = wp.types.vector(8, wp.float32)


@dataclass(frozen=True, kw_only=True)
class MaterialConfig(CommonConfig):
    """Where the maps come from."""

    out: Path = Path("out/mipmap")
    """folder for pictures and files"""
    material: Path | None = None
    """folder with maps, as ambientCG and Poly Haven name them; none: bricks made from two photographs"""
    roughness_scale: Annotated[float, Between(0, 1, above=True)] = 0.4
    """wet it: factor on the roughness (0, 1]"""
    crop: Annotated[int | None, Between(1, 8192)] = None
    """side of the square that is cut out of the middle; none: 256 on the CPU, the whole material on CUDA"""
    factor: Annotated[int, Between(2, 64)] = 4
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
    if config.material is None:
        material = default_material(config.crop or (1024 if device.is_cuda else 256))
    else:
        material = load_material(config.material)
        print(material.sources())  # a map that was not recognised would be learned as a constant
        crop = config.crop or (None if device.is_cuda else min(256, *material.resolution))
        material = material.crop(crop) if crop else material
    height, width = material.resolution
    if height % config.factor or width % config.factor:
        multiple = min(height, width) // config.factor * config.factor
        other = f", or --crop {multiple}" if multiple else ""
        raise InputError(
            f"--factor {config.factor}: does not divide {width} x {height}; choose a factor that does{other}"
        )
    roughness = material.roughness * np.float32(config.roughness_scale)
    specular = np.ones_like(roughness)
    return material.name, Maps(material.albedo, material.normal, roughness, material.metalness, specular)


def pack(maps: Maps, factor: int, device: wp.Device) -> wp.array:
    """`[factor^2, texels, 8]`: all that lies under each texel; neighbouring threads read neighbouring 32 bytes.

    The channels are albedo, roughness, normal x and y (z follows, it is positive), metalness, specular.
    """
    height, width = maps.shape[0] // factor, maps.shape[1] // factor
    single = [image[..., None] for image in (maps.roughness, maps.metalness, maps.specular)]
    channels = np.concatenate([maps.albedo, single[0], maps.normal[..., :2], *single[1:]], axis=-1, dtype=np.float32)
    rows = channels.reshape(height, factor, width, factor, 8).transpose(1, 3, 0, 2, 4)
    return wp.array(rows.reshape(factor * factor, height * width, 8), dtype=float, device=device)


load_channels = make_load(8, wp.float32)
"""`(packed[k], t)`: the channels of texel k of those under texel t."""


@wp.func
def packed_normal(channels: Channels) -> wp.vec3:
    """Unit length."""
    x = channels[4]
    y = channels[5]
    return wp.vec3(x, y, wp.sqrt(wp.max(1.0 - x * x - y * y, 0.0)))


@wp.func
def packed_shade(channels: Channels, light: wp.vec3, view: wp.vec3) -> wp.vec3:
    """The shader on one packed texel: linear radiance."""
    albedo = wp.vec3(channels[0], channels[1], channels[2])
    return brdf(albedo, packed_normal(channels), channels[3], channels[6], channels[7], light, view)
