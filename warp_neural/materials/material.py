"""A material is a set of maps of one size: read from a folder by the usual file names, or written to one."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image, save_image
from warp_neural.materials.choice import MAPS, Offer, choose_maps

DEFAULTS = {
    "albedo": (0.5, 0.5, 0.5),
    "normal": (0.0, 0.0, 1.0),
    "roughness": 0.5,
    "metalness": 0.0,
    "ao": 1.0,
    "height": 0.5,
    "opacity": 1.0,
}
"""What stands in, everywhere, for a map that a folder does not have; linear values."""

RINGING = 0.05
"""How far beyond [0, 1] a float map may go; it is clipped. EXR's lossy DWAA at its usual level 45 goes to 1.03."""


@dataclass(frozen=True)
class Material:
    """Maps of one size, float32. Change one with `dataclasses.replace`, e.g. `roughness=0.4 * material.roughness`.

    Raises `InputError` if the maps are not of one size.
    """

    name: str
    albedo: np.ndarray
    """[height, width, 3], linear, in [0, 1]"""
    normal: np.ndarray
    """[height, width, 3], unit length, in tangent space: x right, y UP the picture (OpenGL), z above 0"""
    roughness: np.ndarray
    """[height, width], in [0, 1], perceptual: GGX's alpha is its square"""
    metalness: np.ndarray
    """[height, width], in [0, 1]"""
    ao: np.ndarray
    """[height, width], ambient occlusion, in [0, 1], 1 is open"""
    height: np.ndarray
    """[height, width], in no stated unit; in [0, 1] from integer files"""
    opacity: np.ndarray
    """[height, width], in [0, 1]"""
    files: Mapping[str, str] = field(default_factory=dict)
    """map name to the file it was read from, and what was done to it: only the maps that were read"""
    unused: tuple[str, ...] = ()
    """names of the pictures in the folder that no map was read from"""

    def __post_init__(self) -> None:
        for name, value in self.maps().items():
            shape = (*self.resolution, 3) if name in ("albedo", "normal") else self.resolution
            if value.shape != shape:
                raise InputError(f"material {self.name}: {name} has shape {value.shape}; make it {shape}")

    @property
    def resolution(self) -> tuple[int, int]:
        """(height, width) of every map, in texels."""
        return self.albedo.shape[:2]

    def maps(self) -> dict[str, np.ndarray]:
        """The maps by name, without the material's own name."""
        return {name: getattr(self, name) for name in MAPS}

    def sources(self) -> str:
        """One line: which map comes from which file, which maps are made up, and which pictures were not used."""
        read = ", ".join(f"{name} from {file}" for name, file in self.files.items())
        absent = [name for name in MAPS if name not in self.files]
        parts = [read, f"no {', '.join(absent)}" if absent else "", f"NOT USED: {', '.join(self.unused)}"]
        return f"material {self.name}: " + "; ".join(part for part in parts[: 3 if self.unused else 2] if part)

    def crop(self, size: int) -> "Material":
        """The square of `size` x `size` texels in the middle. Raises `InputError` if the maps are smaller."""
        height, width = self.resolution
        if not 0 < size <= min(height, width):
            raise InputError(f"material {self.name} is {width} x {height}: no crop of {size}; choose a smaller size")
        top, left = (height - size) // 2, (width - size) // 2
        return replace(
            self,
            **{name: value[top : top + size, left : left + size].copy() for name, value in self.maps().items()},
        )


def load_material(folder: Path | str) -> Material:
    """The maps in `folder`, by the names of all schemes in `naming`, in any format `load_image` reads.

    Case does not count: `PavingStones070_2K-JPG_Color.jpg`, `brick_wall_diff_4k.png`, `albedo.exr` are all the albedo;
    `brick_arm.png` holds three maps. `choose_maps` says which of several files is read; `files` and `unused` of the
    result say which was. Integer albedo files are decoded from sRGB, every other map is linear data. Normals are
    decoded by 2 x - 1 and made unit length; a normal map that does not say so is taken as OpenGL's, DirectX's has its
    green flipped. Gloss becomes roughness, 1 - gloss. A grey map stored as RGB is averaged. A missing map gets its
    value in `DEFAULTS`, a missing opacity the albedo's alpha if it has one. Values up to `RINGING` beyond [0, 1], which
    lossy EXRs have, are clipped.

    Raises `InputError` for a folder without maps, several files for one map, unequal sizes, values further out (height
    may have any), and normals that are nowhere or point into the surface.
    """
    folder = Path(folder)
    choice = choose_maps(folder)
    spaces = {(offer.path, None if name == "albedo" else "linear") for name, offer in choice.maps.items()}
    loaded = {(path, space): load_image(path, color_space=space) for path, space in sorted(spaces, key=str)}
    pixels = {name: loaded[offer.path, None if name == "albedo" else "linear"] for name, offer in choice.maps.items()}
    _check_sizes(choice.maps, pixels)
    height, width = next(iter(pixels.values())).shape[:2]
    maps = {
        name: np.broadcast_to(np.float32(value), (height, width, *np.shape(value))).copy()
        for name, value in DEFAULTS.items()
    }
    for name, offer in choice.maps.items():
        maps[name] = _decode(name, offer, pixels[name])
    files = {name: str(offer) for name, offer in choice.maps.items()}
    if "opacity" not in files and "albedo" in files and pixels["albedo"].shape[-1] == 4:
        maps["opacity"] = np.ascontiguousarray(np.clip(pixels["albedo"][..., 3], 0, 1))
        files["opacity"] = f"{choice.maps['albedo'].path.name} (alpha channel)"
    return Material(folder.resolve().name, **maps, files=files, unused=choice.unused)


def save_material(folder: Path | str, material: Material) -> None:
    """Write every map to `folder` as a 16-bit PNG with its plain name; `load_material` reads them to within 1/65535.

    Albedo is encoded to sRGB, the others are linear data; height is clipped to [0, 1]. Files of the same name are
    replaced, others stay. Raises `InputError` if the folder cannot be written.
    """
    for name, value in material.maps().items():
        stored = value * 0.5 + 0.5 if name == "normal" else value
        space = "srgb" if name == "albedo" else "linear"
        save_image(Path(folder) / f"{name}.png", stored, color_space=space, bits=16)


def find_maps(folder: Path | str) -> dict[str, Path]:
    """Which file holds which map: map name to path, only the maps there are; raises as `choose_maps` does."""
    return {name: offer.path for name, offer in choose_maps(folder).maps.items()}


def _check_sizes(maps: dict[str, Offer], pixels: dict[str, np.ndarray]) -> None:
    first, *others = maps
    for name in others:
        if pixels[name].shape[:2] != pixels[first].shape[:2]:
            sizes = " and ".join(
                f"{maps[n].path.name} {pixels[n].shape[1]} x {pixels[n].shape[0]}" for n in (first, name)
            )
            raise InputError(f"{maps[first].path.parent}: maps of unequal sizes, {sizes}; scale them to one size")


def _decode(name: str, offer: Offer, pixels: np.ndarray) -> np.ndarray:
    """A loaded file to the map `name`."""
    if offer.part.channel is not None:
        if pixels.shape[-1] <= max(2, offer.part.channel):
            raise InputError(
                f"{offer.path}: has no channel for the {name}; a picture of several maps needs them in its channels"
            )
        pixels = pixels[..., offer.part.channel :][..., :1]
    _check_range(name, offer.path, pixels)
    if name == "normal":
        return _decode_normal(offer.path, pixels, flip=offer.part.directx)
    if name == "albedo":
        return np.clip(np.broadcast_to(pixels[..., :3], (*pixels.shape[:2], 3)), 0, 1)
    scalar = pixels[..., :3].mean(axis=-1)
    scalar = 1 - scalar if offer.part.inverted else scalar
    return scalar if name == "height" else np.clip(scalar, 0, 1)


def _check_range(name: str, path: Path, values: np.ndarray) -> None:
    low, high = float(values.min()), float(values.max())
    if name != "height" and (low < -RINGING or high > 1 + RINGING):
        raise InputError(f"{path}: {name} has values from {low:.6g} to {high:.6g}; bring them into 0 to 1")


def _decode_normal(path: Path, encoded: np.ndarray, flip: bool) -> np.ndarray:
    """Encoded [0, 1] `[height, width, 3]` to unit vectors; the odd texel without a direction becomes flat."""
    if encoded.shape[-1] < 3:
        raise InputError(f"{path}: a normal map needs 3 channels; this grey picture may be a height map")
    normal = np.clip(encoded[..., :3], 0, 1) * 2 - 1
    if flip:
        normal[..., 1] *= -1
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    bad = (length[..., 0] < 0.1) | (normal[..., 2] <= 0)
    if bad.mean() > 0.01:
        raise InputError(
            f"{path}: {bad.mean():.0%} of the normals have no length or point into the surface; "
            "give a tangent-space normal map, whose flat colour is (128, 128, 255)"
        )
    normal = normal / np.maximum(length, 1e-6)
    normal[bad] = DEFAULTS["normal"]
    return normal
