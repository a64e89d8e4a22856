"""How near decoded maps come to the original ones, and where one codec's curve passes another's."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import warp as wp

from perf import recorded, texture_sphere
from perf.texture_peers import Coded, Maps
from warp_neural.errors import InputError
from warp_neural.texture import measure
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.maps import load_set

OURS, RTXNTC = "Warp Neural", "RTXNTC (recorded)"


@dataclass(frozen=True)
class Point:
    """One codec at one setting. bits: a texel of mip 0, all files; figures: by measure, as 'PSNR' in dB over all
    channels of all maps, 'albedo SSIM', 'sphere FLIP'."""

    codec: str
    setting: str
    bits: float
    figures: dict[str, float] = field(default_factory=dict)


def higher_is_better(name: str) -> bool:
    return not name.endswith("FLIP")


def load_maps(folder: Path, crop: int | None) -> Maps:
    """The maps of a folder, those that vary and those that do not, as `codes_of`; crop: the square in the middle."""
    texture_set = load_set(folder)
    if beyond := [
        each.name for each in texture_set.maps if each.kind == "hdr" or min(each.low) < 0 or max(each.high) > 1
    ]:
        raise InputError(f"{folder}: {', '.join(beyond)} go beyond [0, 1]; only maps that 8 bits hold are compared")
    values = texture_set.values
    if crop:
        top, left = (max(side - crop, 0) // 2 for side in texture_set.size)
        values = values[top : top + crop, left : left + crop]
    return codes_of(to_maps(values, texture_set.maps))


def codes_of(stored: dict[str, np.ndarray]) -> Maps:
    """Maps as stored, in [0, 1], to uint8 [height, width, 1 or 3]; an alpha is a map of its own."""
    maps = {}
    for name, values in stored.items():
        pixels = np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
        colours = 3 if pixels.shape[2] > 2 else 1
        maps[name] = pixels[..., :colours]
        if pixels.shape[2] > colours:
            maps[f"{name} alpha"] = pixels[..., colours : colours + 1]
    return maps


class Judge:
    """Compares decoded maps with `maps`; what it has seen, as one map in two settings, it does not compare again."""

    def __init__(self, maps: Maps, device: wp.Device):
        self.maps, self.device, self.seen = maps, device, {}
        self.texels = next(iter(maps.values()))[..., 0].size
        self.sphere = texture_sphere.render(maps, device)

    def point(self, coded: Coded) -> Point:
        whole = (np.concatenate([maps[name].ravel() for name in self.maps]) for maps in (self.maps, coded.maps))
        figures = {"PSNR": measure.psnr(*map(displayed, whole))}
        for name in self.maps:
            figures |= self.of_map(name, coded.maps[name])
        figures["sphere FLIP"] = measure.flip(self.sphere, texture_sphere.render(coded.maps, self.device))
        return Point(coded.codec, coded.setting, 8 * coded.size / self.texels, figures)

    def of_map(self, name: str, decoded: np.ndarray) -> dict[str, float]:
        key = name, decoded.tobytes()
        if key not in self.seen:
            pair = displayed(self.maps[name]), displayed(decoded)
            measures = {"PSNR": measure.psnr, "SSIM": measure.ssim, "FLIP": measure.flip}
            found = {f"{name} {what}": function(*pair) for what, function in measures.items()}
            self.seen[key] = {what: value for what, value in found.items() if value is not None}  # SSIM of few texels
        return self.seen[key]


def displayed(codes: np.ndarray) -> np.ndarray:
    return codes / np.float32(255)


def recorded_points(material: str) -> list[Point]:
    return [Point(RTXNTC, f"{bits}", bits, {"PSNR": psnr}) for bits, psnr in recorded.RTXNTC.get(material, [])]


def between(curve: list[Point], name: str, bits: float) -> float | None:
    """A codec's figure at `bits`, its points joined over the logarithm of bits; None beyond its points."""
    points = sorted((point.bits, point.figures[name]) for point in curve if name in point.figures)
    if not points or not points[0][0] <= bits <= points[-1][0]:
        return None
    x, y = np.array(points).T
    return float(np.interp(np.log(bits), np.log(x), y))


@dataclass(frozen=True)
class Loss:
    """A point of another codec that is better than ours at `bits`: its own, or those of our largest file."""

    other: Point
    figure: str
    bits: float
    ours: float


def losses(points: list[Point]) -> list[Loss]:
    ours = [point for point in points if point.codec == OURS]
    largest = max((point.bits for point in ours), default=0.0)
    found = []
    for other in (point for point in points if point.codec != OURS):
        for name, value in other.figures.items():
            bits = min(other.bits, largest)
            here = between(ours, name, bits)
            if here is not None and (value > here if higher_is_better(name) else value < here):
                found.append(Loss(other, name, bits, here))
    return found
