"""What a texture set is made from: pictures as stored, by the names of their maps, from folders, files, arrays."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np

from warp_neural.errors import InputError
from warp_neural.imaging.exr import load_exr
from warp_neural.imaging.image import linear_to_srgb, load_stored
from warp_neural.materials.choice import choose_maps
from warp_neural.materials.material import Material
from warp_neural.materials.naming import Part, read_name

FLOATS = 32
_NAME = re.compile(r"[^\x00-\x1f/\\:*?\"<>|]{1,100}")  # what every file system takes


@dataclass(frozen=True)
class Picture:
    """One map as stored: sRGB-encoded colours, normals as (x + 1) / 2, gloss as gloss."""

    name: str
    of: str | None
    """which map of a material it is; None for any other picture"""
    levels: tuple[np.ndarray, ...]
    """float32 [height, width, 1 to 4], finest first; one where no mip levels are given"""
    file: str = ""
    bits: int = 8
    """8, 16, or `FLOATS`"""


@dataclass(frozen=True)
class Place:
    """Where a map is."""

    path: Path
    of: str | None
    part: Part | None = None


def pictures_of(source: Any, only: Sequence[str] | None = None) -> tuple[list[Picture], tuple[str, ...]]:
    """The pictures of a folder, files, dict of arrays or `Material`, and the names of the files left out.

    Of a folder, its material's maps are named as in `Material`, but gloss and normal_dx, which stay as they are; any
    other picture by its file. Folders level_0, level_1, ... in it, as `samples.mipmap` writes them, are mip levels. Of
    arrays, integers are codes, floats values as stored. only: names of the maps to read, of all that there are.
    Raises `InputError` for what cannot be read or has no such map.
    """
    if isinstance(source, Material):
        return _chosen(_of_material(source), only, f"material {source.name}"), ()
    if isinstance(source, Mapping):
        return _chosen([_of_array(name, array) for name, array in source.items()], only, "the arrays"), ()
    if isinstance(source, str | Path) and not Path(source).is_file():
        return _of_folder(Path(source), only)
    files = [source] if isinstance(source, str | Path) else source
    if not isinstance(files, Sequence) or not all(isinstance(each, str | Path) for each in files):
        raise InputError(f"a source of type {type(source).__name__}; give a folder, files, arrays or a Material")
    named = _named("the files", [place for each in files for place in _places(Path(each))])
    return [_load(name, [named[name]]) for name in _names(named, only, "the files")], ()


def _of_folder(folder: Path, only: Sequence[str] | None) -> tuple[list[Picture], tuple[str, ...]]:
    levels = list(takewhile(Path.is_dir, (folder / f"level_{k}" for k in count()))) or [folder]
    found = [_in_folder(level) for level in levels]
    names = _names(found[0][0], only, str(levels[0]))
    for level, (places, _) in zip(levels, found, strict=True):
        if missing := [name for name in names if name not in places]:
            raise InputError(f"{level}: has no {missing[0]}, which level_0 has; every level needs all maps")
    return [_load(name, [places[name] for places, _ in found]) for name in names], found[0][1]


def _in_folder(folder: Path) -> tuple[dict[str, Place], tuple[str, ...]]:
    """Its maps by name, and the pictures left out: of maps that are there in another form, several maps in one EXR."""
    choice = choose_maps(folder, needed=False)
    places = [Place(offer.path, name, offer.part) for name, offer in choice.maps.items()]
    others = [folder / name for name in choice.unused]
    left = [path.name for path in others if read_name(path.stem) or _of_many(path)]
    places += [Place(path, None) for path in others if path.name not in left]
    if not places:
        raise InputError(f"{folder}: holds no picture; give a folder with some")
    return _named(str(folder), places), tuple(left)


def _of_many(path: Path) -> bool:
    if path.suffix.lower() != ".exr":
        return False
    names = set(load_exr(path))
    return len(names) > 1 and not names <= set("YRGBA")


def _places(path: Path) -> list[Place]:
    name = read_name(path.stem)
    return [Place(path, part.map, part) for part in name.parts] if name else [Place(path, None)]


def _named(where: str, places: list[Place]) -> dict[str, Place]:
    named: dict[str, Place] = {}
    for place in places:
        name = _map_name(place)
        other = next((old for old in named if old.lower() == name.lower()), None)
        if other:
            files = f"{named[other].path.name} and {place.path.name}"
            raise InputError(f"{where}: {files} could each be the map {name}; leave one of them or rename it")
        named[name] = place
    return named


def _map_name(place: Place) -> str:
    if place.part and place.part.directx:
        return "normal_dx"
    return "gloss" if place.part and place.part.inverted else place.of or place.path.stem


def _names(there: Mapping[str, Any], only: Sequence[str] | None, where: str) -> list[str]:
    for name in only or ():
        if name not in there:
            raise InputError(f"--maps {name}: {where} holds {', '.join(there) or 'no maps'}; give some of these")
    return [name for name in there if only is None or name in only]


def _chosen(pictures: list[Picture], only: Sequence[str] | None, where: str) -> list[Picture]:
    there = {picture.name: picture for picture in pictures}
    return [there[name] for name in _names(there, only, where)]


def _load(name: str, places: list[Place]) -> Picture:
    loaded = [load_stored(place.path) for place in places]
    levels = tuple(_part(place, pixels) for place, (pixels, _) in zip(places, loaded, strict=True))
    return Picture(name, places[0].of, levels, places[0].path.name, loaded[0][1])


def _part(place: Place, pixels: np.ndarray) -> np.ndarray:
    if place.part is None or place.part.channel is None:
        return pixels
    if pixels.shape[-1] <= max(2, place.part.channel):
        raise InputError(
            f"{place.path}: has no channel for the {place.of}; a picture of several maps needs them in its channels"
        )
    return np.ascontiguousarray(pixels[..., place.part.channel :][..., :1])


def _of_material(material: Material) -> list[Picture]:
    stored = {"albedo": linear_to_srgb, "normal": lambda x: 0.5 * x + 0.5}
    arrays = {name: stored.get(name, np.asarray)(value) for name, value in material.maps().items()}
    return [_of_array(name, array) for name, array in arrays.items() if name in (material.files or arrays)]


def _of_array(name: str, array: Any) -> Picture:
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name.strip(". ") != name:
        raise InputError(f"map {name!r}: no name for a file; name maps as in 'albedo'")
    array = np.asarray(array)
    array = array[..., None] if array.ndim == 2 else array
    if array.ndim != 3 or 0 in array.shape or array.shape[-1] > 4:
        raise InputError(
            f"map {name}: an array of shape {array.shape}; give [height, width] or [height, width, 1 to 4]"
        )
    tops = {"bool": 1, "uint8": 2**8 - 1, "uint16": 2**16 - 1}
    if array.dtype.kind != "f" and array.dtype.name not in tops:
        raise InputError(f"map {name}: values of type {array.dtype}; give floats, uint8, uint16 or bool")
    with np.errstate(over="ignore"):  # beyond float32 it is infinite, and refused
        values = (array / np.float64(tops.get(array.dtype.name, 1))).astype(np.float32)
    if not np.isfinite(values).all():
        raise InputError(f"map {name}: NaN or infinite values; repair them first")
    bits = 8 if array.dtype.name in ("bool", "uint8") else 16
    floats = values.min() < 0 or values.max() > 1
    part = next(iter(found.parts), None) if (found := read_name(name)) and len(found.parts) == 1 else None
    return Picture(name, part and part.map, (values,), "", FLOATS if floats else bits)
