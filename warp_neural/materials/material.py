"""A material is a set of maps of one size: read from a folder by the usual file names, or written to one."""

import re
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image, save_image, suffixes

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

_TAGS = {  # the words that name a map: ambientCG's, Poly Haven's and plain ones, lower case
    "albedo": ("color", "diff", "albedo"),
    "normal": ("normalgl", "nor_gl", "normal", "normaldx", "nor_dx"),
    "roughness": ("roughness", "rough"),
    "metalness": ("metalness", "metal"),
    "ao": ("ambientocclusion", "ao"),
    "height": ("displacement", "disp", "height"),
    "opacity": ("opacity",),
}
_DIRECTX = ("normaldx", "nor_dx")
_TOLERANCE = 1e-3  # how far beyond [0, 1] the ringing of lossy float files may go before it is an error


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
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name != "name"}

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
    """The maps in `folder`, by the names of ambientCG, Poly Haven or plain ones, in any format `load_image` reads.

    Case does not count: `PavingStones070_2K-JPG_Color.jpg`, `brick_wall_diff_4k.png`, `albedo.exr` are all the albedo.
    Integer albedo files are decoded from sRGB, every other map is linear data. Normals are decoded by 2 x - 1 and made
    unit length; of an OpenGL and a DirectX map the OpenGL one is read, a lone DirectX map has its green flipped. A grey
    map stored as RGB is averaged. A missing map gets its value in `DEFAULTS`, a missing opacity the albedo's alpha if
    it has one.

    Raises `InputError` for a folder without maps, several files for one map, unequal sizes, values outside [0, 1]
    (height may have any), and normals that are nowhere or point into the surface.
    """
    folder = Path(folder)
    files = find_maps(folder)
    loaded = {
        name: load_image(path, color_space=None if name == "albedo" else "linear") for name, path in files.items()
    }
    _check_sizes(files, loaded)
    height, width = next(iter(loaded.values())).shape[:2]
    maps = {
        name: np.broadcast_to(np.float32(value), (height, width, *np.shape(value))).copy()
        for name, value in DEFAULTS.items()
    }
    for name, path in files.items():
        _check_range(name, path, loaded[name])
        if name == "normal":
            maps[name] = _decode_normal(path, loaded[name], flip=_tag(path.name) in _DIRECTX)
        elif name == "albedo":
            maps[name][:] = np.clip(loaded[name][..., :3], 0, 1)
        else:
            scalar = loaded[name][..., :3].mean(axis=-1)
            maps[name] = scalar if name == "height" else np.clip(scalar, 0, 1)
    if "opacity" not in files and "albedo" in files and loaded["albedo"].shape[-1] == 4:
        maps["opacity"] = np.ascontiguousarray(loaded["albedo"][..., 3])
    return Material(folder.resolve().name, **maps)


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
    """Which file holds which map: map name to path, only the maps there are.

    Raises `InputError` for a folder that is missing or has no map, and for several files that could be one map.
    """
    folder = Path(folder)
    try:
        paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in suffixes())
    except OSError as error:
        raise InputError(f"{folder}: not a readable folder ({error.strerror}); give one that holds maps") from error
    found = {}
    for name in DEFAULTS:
        candidates = [path for path in paths if map_of(path.name) == name]
        if any(_tag(path.name) not in _DIRECTX for path in candidates):  # ambientCG ships both conventions
            candidates = [path for path in candidates if _tag(path.name) not in _DIRECTX]
        if len(candidates) > 1:
            names = " and ".join(path.name for path in candidates)
            raise InputError(f"{folder}: {names} could each be the {name}; leave one of them")
        if candidates:
            found[name] = candidates[0]
    if not found:
        words = "; ".join(f"{name}: {', '.join(tags)}" for name, tags in _TAGS.items())
        raise InputError(f"{folder}: holds no map; name files (AnyName_)WORD(_2k).png with one of the words {words}")
    return found


def map_of(name: str) -> str | None:
    """The map that a file of this name holds, e.g. `height` for `Rock_disp_4k.png`; None for any other file."""
    return next((map_name for map_name, tags in _TAGS.items() if _tag(name) in tags), None)


def _tag(name: str) -> str | None:
    """The word that ends a file's name, without a resolution after it: `nor_gl` of `Rock_nor_gl_4k.png`."""
    stem = re.sub(r"([ ._-]\d+k)+$", "", Path(name).stem.lower())
    words = (tag for tags in _TAGS.values() for tag in tags)
    return next((tag for tag in words if re.search(rf"(^|[ ._-]){tag}$", stem)), None)


def _check_sizes(files: dict[str, Path], loaded: dict[str, np.ndarray]) -> None:
    first, *others = files
    for name in others:
        if loaded[name].shape[:2] != loaded[first].shape[:2]:
            sizes = " and ".join(f"{files[n].name} {loaded[n].shape[1]} x {loaded[n].shape[0]}" for n in (first, name))
            raise InputError(f"{files[first].parent}: maps of unequal sizes, {sizes}; scale them to one size")


def _check_range(name: str, path: Path, values: np.ndarray) -> None:
    low, high = float(values.min()), float(values.max())
    if name != "height" and (low < -_TOLERANCE or high > 1 + _TOLERANCE):
        raise InputError(f"{path}: {name} has values from {low:.6g} to {high:.6g}; bring them into 0 to 1")


def _decode_normal(path: Path, encoded: np.ndarray, flip: bool) -> np.ndarray:
    """Encoded [0, 1] `[height, width, 3]` to unit vectors; the odd texel without a direction becomes flat."""
    if encoded.shape[-1] < 3:
        raise InputError(f"{path}: a normal map needs 3 channels; this grey picture may be a height map")
    normal = encoded[..., :3] * 2 - 1
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
