"""A material as codecs are given it, in 8 bits a channel, and how near what they make of it comes."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import warp as wp

from perf import recorded, texture_sphere
from perf.texture_peers import Coded, Maps
from warp_neural.texture import measure
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.maps import TextureSet, load_set
from warp_neural.texture.state import Map

OURS, RTXNTC = "Warp Neural", "RTXNTC (recorded)"


@dataclass(frozen=True)
class Point:
    """One codec at one setting. bits: a texel of mip 0, all files, everything counted; figures: by measure, as 'PSNR'
    in dB over all channels of all maps, 'albedo SSIM', 'normal degrees', 'sphere FLIP'."""

    codec: str
    setting: str
    bits: float
    figures: dict[str, float] = field(default_factory=dict)


def higher_is_better(name: str) -> bool:
    return name.endswith(("PSNR", "SSIM"))


def load_material(source: Path, crop: int | None) -> TextureSet:
    """A folder or a picture, mip 0; crop: the square in the middle."""
    texture_set = load_set(source)
    values = texture_set.values
    if crop:
        top, left = (max(side - crop, 0) // 2 for side in texture_set.size)
        values = values[top : top + crop, left : left + crop]
    return replace(texture_set, levels=(values,))


def original_codes(texture_set: TextureSet) -> Maps:
    return codes_of(to_maps(texture_set.values, texture_set.maps), texture_set.maps)


def codes_of(stored: dict[str, np.ndarray], described: Sequence[Map]) -> Maps:
    """Maps as stored to uint8 [height, width, 1 or 3]: hdr as its logarithms over their range, what goes beyond [0, 1]
    over its own; an alpha is a map of its own."""
    maps = {}
    for each in described:
        values = stored[each.name]
        maps[each.name] = to_codes(measure.shown(values, each))
        if each.channels in (2, 4):
            maps[f"{each.name} alpha"] = to_codes(values[..., -1:])
    return maps


def to_codes(values: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)


class Judge:
    """Compares decoded maps with a material's; what it has seen, as one map in two settings, it does not again."""

    def __init__(self, texture_set: TextureSet, device: wp.Device):
        self.maps, self.device, self.seen = original_codes(texture_set), device, {}
        self.described = {each.name: each for each in texture_set.maps}
        self.texels = next(iter(self.maps.values()))[..., 0].size
        self.sphere = self.rendered(self.maps)

    def point(self, coded: Coded) -> Point:
        whole = (np.concatenate([maps[name].ravel() for name in self.maps]) for maps in (self.maps, coded.maps))
        figures = {"PSNR": measure.psnr(*map(displayed, whole))}
        for name in self.maps:
            figures |= self.of_map(name, coded.maps[name])
        if self.sphere is not None:
            figures["sphere FLIP"] = measure.flip(self.sphere, self.rendered(coded.maps))
        return Point(coded.codec, coded.setting, 8 * coded.size / self.texels, figures)

    def rendered(self, maps: Maps) -> np.ndarray | None:
        """The lit sphere; None for pictures that are no material."""
        kinds = {name: each.kind for name, each in self.described.items()}
        used = {name: maps[name] for name in texture_sphere.USED if kinds.get(name, "hdr") != "hdr"}
        return texture_sphere.render(used, self.device) if used else None

    def of_map(self, name: str, decoded: np.ndarray) -> dict[str, float]:
        """PSNR, SSIM and FLIP; of normals the mean angle in degrees, of hdr the root mean square relative error."""
        key = name, decoded.tobytes()
        if key not in self.seen:
            pair = displayed(self.maps[name]), displayed(decoded)
            measures = {"PSNR": measure.psnr, "SSIM": measure.ssim, "FLIP": measure.flip}
            found = {f"{name} {what}": function(*pair) for what, function in measures.items()}
            found = {what: value for what, value in found.items() if value is not None}  # SSIM of few texels
            each = self.described.get(name)
            if each and each.kind == "normal":
                found[f"{name} degrees"] = measure.angle(*pair)
            if each and each.kind == "hdr":
                linear = (light(picture, each) for picture in pair)
                found[f"{name} relative error"] = measure.relative_error(*linear, 2.0 ** each.span[0])
            self.seen[key] = found
        return self.seen[key]


def displayed(codes: np.ndarray) -> np.ndarray:
    return codes / np.float32(255)


def light(picture: np.ndarray, each: Map) -> np.ndarray:
    """Linear values of an hdr map from its logarithms over their range, the inverse of `measure.shown`."""
    low, high = each.span
    return np.maximum(2 ** (low + np.float64(picture) * (high - low)) - 2**low, 0)


def recorded_points(material: str) -> list[Point]:
    return [Point(RTXNTC, f"{bits}", bits, {"PSNR": psnr}) for bits, psnr in recorded.RTXNTC.get(material, [])]
