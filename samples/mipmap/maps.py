"""The maps of one mip level, and the options that choose the material they come from."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import warp as wp

from warp_neural.cli import CommonConfig
from warp_neural.default_material import default_material
from warp_neural.errors import InputError
from warp_neural.material import load_material
from warp_neural.shading import brdf


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
    """`[factor^2, 8, texels]`: all that lies under each texel, one plane for each of its texels and channels.

    Neighbouring threads read neighbouring floats. The channels are albedo, roughness, normal x and y (z follows, it is
    positive), metalness, specular.
    """
    height, width = maps.shape[0] // factor, maps.shape[1] // factor
    single = [image[..., None] for image in (maps.roughness, maps.metalness, maps.specular)]
    channels = np.concatenate([maps.albedo, single[0], maps.normal[..., :2], *single[1:]], axis=-1, dtype=np.float32)
    planes = channels.reshape(height, factor, width, factor, 8).transpose(1, 3, 4, 0, 2)
    return wp.array(planes.reshape(factor * factor, 8, height * width), dtype=float, device=device)


@wp.func
def packed_albedo(packed: wp.array3d[float], k: int, t: int) -> wp.vec3:
    """Of texel k of those under texel t; likewise below."""
    return wp.vec3(packed[k, 0, t], packed[k, 1, t], packed[k, 2, t])


@wp.func
def packed_roughness(packed: wp.array3d[float], k: int, t: int) -> float:
    return packed[k, 3, t]


@wp.func
def packed_normal(packed: wp.array3d[float], k: int, t: int) -> wp.vec3:
    """Unit length."""
    x = packed[k, 4, t]
    y = packed[k, 5, t]
    return wp.vec3(x, y, wp.sqrt(wp.max(1.0 - x * x - y * y, 0.0)))


@wp.func
def packed_shade(packed: wp.array3d[float], k: int, t: int, light: wp.vec3, view: wp.vec3) -> wp.vec3:
    """The shader on one packed texel: linear radiance."""
    albedo = packed_albedo(packed, k, t)
    normal = packed_normal(packed, k, t)
    return brdf(albedo, normal, packed_roughness(packed, k, t), packed[k, 6, t], packed[k, 7, t], light, view)
