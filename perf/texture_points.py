"""How near decoded maps come to the original ones, and where one codec's curve passes another's."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import warp as wp

from perf import recorded, texture_sphere
from perf.texture_peers import Coded, Maps
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image
from warp_neural.materials.choice import choose_maps

OURS, RTXNTC = "Warp Neural", "RTXNTC (recorded)"


@dataclass(frozen=True)
class Point:
    """One codec at one setting. bits: a texel of mip 0, all files; figures: by measure, as 'PSNR' in dB over all
    channels of all maps, 'albedo SSIM', 'sphere FLIP'."""

    codec: str
    setting: str
    bits: float
    figures: dict[str, float] = field(default_factory=dict)


def higher_is_better(measure: str) -> bool:
    return not measure.endswith("FLIP")


def load_maps(folder: Path, crop: int | None) -> Maps:
    """Values as stored, uint8 [height, width, 3] of albedo and normal, [height, width, 1] of the others."""
    maps = {}
    for name, offer in choose_maps(folder).maps.items():
        pixels = load_image(offer.path, color_space="linear")
        first = offer.part.channel or 0
        wide = name in ("albedo", "normal")
        pixels = np.repeat(pixels, 3, axis=-1) if wide and pixels.shape[-1] == 1 else pixels
        pixels = pixels[..., :3] if wide else pixels[..., first : first + 1]
        maps[name] = cut(np.rint(255 * np.clip(pixels, 0, 1)).astype(np.uint8), crop)
    if len({pixels.shape[:2] for pixels in maps.values()}) > 1:
        raise InputError(f"{folder}: maps of several sizes; resize them to one")
    return maps


def cut(pixels: np.ndarray, crop: int | None) -> np.ndarray:
    """The square in the middle."""
    if crop is None:
        return pixels
    top, left = (max(side - crop, 0) // 2 for side in pixels.shape[:2])
    return np.ascontiguousarray(pixels[top : top + crop, left : left + crop])


class Judge:
    """Compares decoded maps with `maps`; what it has seen, as one map in two settings, it does not compare again."""

    def __init__(self, maps: Maps, device: wp.Device):
        self.maps, self.device, self.seen = maps, device, {}
        self.texels = next(iter(maps.values()))[..., 0].size
        self.sphere = texture_sphere.render(maps, device)

    def point(self, coded: Coded) -> Point:
        errors = [np.square(pixels.astype(float) - coded.maps[name]) for name, pixels in self.maps.items()]
        figures = {"PSNR": psnr(np.concatenate([each.ravel() for each in errors]).mean())}
        for name in self.maps:
            figures |= self.of_map(name, coded.maps[name])
        figures["sphere FLIP"] = flip(self.sphere, texture_sphere.render(coded.maps, self.device))
        return Point(coded.codec, coded.setting, 8 * coded.size / self.texels, figures)

    def of_map(self, name: str, decoded: np.ndarray) -> dict[str, float]:
        key = name, decoded.tobytes()
        if key not in self.seen:
            original = self.maps[name]
            shown, truth = (
                np.repeat(each, 3 // each.shape[2], axis=2) / np.float32(255) for each in (decoded, original)
            )
            self.seen[key] = {
                f"{name} PSNR": psnr(np.square(original.astype(float) - decoded).mean()),
                f"{name} SSIM": ssim(original, decoded),
                f"{name} FLIP": flip(truth, shown),
            }
        return self.seen[key]


def psnr(error: float) -> float:
    """Of a mean square of 8-bit codes, in dB, 99 at most."""
    return float(min(10 * np.log10(255**2 / max(error, 1e-9)), 99))


def ssim(original: np.ndarray, decoded: np.ndarray) -> float:
    from skimage.metrics import structural_similarity

    return float(structural_similarity(original, decoded, channel_axis=2, data_range=255))


def flip(truth: np.ndarray, shown: np.ndarray) -> float:
    """FLIP (Andersson et al. 2020), the mean; its default viewing distance of 67 pixels a degree."""
    import flip_evaluator

    return float(flip_evaluator.evaluate(truth, shown, "LDR", applyMagma=False)[1])


def recorded_points(material: str) -> list[Point]:
    return [Point(RTXNTC, f"{bits}", bits, {"PSNR": psnr}) for bits, psnr in recorded.RTXNTC.get(material, [])]


def between(curve: list[Point], measure: str, bits: float) -> float | None:
    """A codec's figure at `bits`, its points joined over the logarithm of bits; None beyond its points."""
    points = sorted((point.bits, point.figures[measure]) for point in curve if measure in point.figures)
    if not points or not points[0][0] <= bits <= points[-1][0]:
        return None
    x, y = np.array(points).T
    return float(np.interp(np.log(bits), np.log(x), y))


@dataclass(frozen=True)
class Loss:
    """A point of another codec that is better than ours at `bits`: its own, or those of our largest file."""

    other: Point
    measure: str
    bits: float
    ours: float


def losses(points: list[Point]) -> list[Loss]:
    ours = [point for point in points if point.codec == OURS]
    largest = max((point.bits for point in ours), default=0.0)
    found = []
    for other in (point for point in points if point.codec != OURS):
        for measure, value in other.figures.items():
            bits = min(other.bits, largest)
            here = between(ours, measure, bits)
            if here is not None and (value > here if higher_is_better(measure) else value < here):
                found.append(Loss(other, measure, bits, here))
    return found
