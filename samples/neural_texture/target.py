"""What the steps share and do not teach: the material's channels, and pictures of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import warp as wp

from warp_neural import cli
from warp_neural.cli import Between, CommonConfig, Count, Positive, Samples
from warp_neural.errors import InputError
from warp_neural.materials.default_material import default_material
from warp_neural.samples.figures import save_picture
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.maps import TextureSet, load_set
from warp_neural.texture.measure import codes, shown

SHOWN = 3.7  # bits a texel, about those of the codec's file


@dataclass(frozen=True, kw_only=True)
class Config(CommonConfig):
    """The options of every step."""

    out: Path = Path("out/neural_texture")
    """folder for pictures and files"""
    material: Path | None = None
    """folder with maps, as ambientCG and Poly Haven name them; none: bricks made from two photographs"""
    side: Annotated[int | None, Between(16, 4096, multiple=16)] = None
    """texels of the square that is cut out of the material's middle; none: 256 on the CPU, 512 on CUDA"""
    steps: Count | None = None
    """gradient steps of a training; none: 800 on the CPU, 4000 on CUDA"""
    batch: Samples | None = None
    """texels of a step; none: 4096 on the CPU, 65,536 on CUDA"""
    rate: Positive = 0.02
    """Adam's learning rate of the network at the start; it falls on a cosine"""

    def effort(self, device: wp.Device) -> tuple[int, int]:
        """(steps, batch)."""
        steps, batch = (4000, 1 << 16) if device.is_cuda else (800, 1 << 12)
        return self.steps or steps, self.batch or batch


def load_target(config: Config) -> TextureSet:
    """Maps and their channels that vary, 8-bit codes / 255, `values` [side, side, channels]. Raises `InputError`."""
    side = config.side or (512 if cli.resolve_device(config.device).is_cuda else 256)
    found = load_set(config.material or default_material(side))
    if min(found.size) < side:
        raise InputError(f"--side {side}: the material has {found.size[1]} x {found.size[0]} texels")
    top, left = ((length - side) // 2 for length in found.size)
    values = codes(found.values[top : top + side, left : left + side])
    return TextureSet(found.name, found.maps, (values,))


def report(config: Config, name: str, curve: Callable[[Config, TextureSet], Sequence[Any]]) -> dict:
    """Run a step, save `name`.png: its points by bits a texel."""
    target = load_target(config)
    points = sorted(curve(config, target), key=lambda point: point.bits)
    save_beside(config.out / f"{name}.png", target, shown_of(points).values)
    return {name: [point.row for point in points]}


def shown_of(points: Sequence[Any]) -> Any:
    """The point that pictures show, the one nearest to `SHOWN`."""
    return min(points, key=lambda point: abs(np.log2(point.bits / SHOWN)))


def save_beside(path: Path, target: TextureSet, values: np.ndarray) -> None:
    """Albedo, normal and all other maps below each other: the target on the left, what was decoded on the right."""
    save_picture(path, np.concatenate([picture_of(target.values, target), picture_of(values, target)], axis=1))


def picture_of(values: np.ndarray, target: TextureSet, side: int = 256) -> np.ndarray:
    """The middle of all maps that vary, below each other, [maps * side, side, 3] displayed."""
    maps = [each for each in target.maps if each.trained]
    stored = to_maps(values, target.maps)
    top = max(len(values) - side, 0) // 2
    crops = [shown(stored[each.name][top : top + side, top : top + side], each) for each in maps]
    return np.concatenate([np.broadcast_to(crop, (*crop.shape[:2], 3)) for crop in crops])
