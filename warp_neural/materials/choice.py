"""Which file of a folder is read for which map, by stated rules, and which pictures are left."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from warp_neural.errors import InputError
from warp_neural.imaging.image import suffixes
from warp_neural.materials.naming import SEPARATOR, WORDS, Name, Part, is_preview, read_name

MAPS = ("albedo", "normal", "roughness", "metalness", "ao", "height", "opacity")

_CHANNELS = ("red", "green", "blue", "alpha")


@dataclass(frozen=True)
class Offer:
    """A map in a file."""

    path: Path
    name: Name
    part: Part

    @property
    def rank(self) -> int:
        """The lower is read: a file of its own, before one that has to be turned over, before a channel of several."""
        return 2 if len(self.name.parts) > 1 else int(self.part.inverted or self.part.directx)

    def __str__(self) -> str:
        changes = [f"{_CHANNELS[self.part.channel]} channel"] if self.part.channel is not None else []
        changes += ["inverted"] * self.part.inverted + ["DirectX, green flipped"] * self.part.directx
        return f"{self.path.name} ({', '.join(changes)})" if changes else self.path.name


@dataclass(frozen=True)
class Choice:
    """What a folder is read as."""

    maps: dict[str, Offer]
    """by the map's name, only the maps there are"""
    unused: tuple[str, ...]
    """names of the pictures that no map is read from, without pictures of the material itself"""


def choose_maps(folder: Path | str, needed: bool = True) -> Choice:
    """Choose by the files' names. Hidden files, so macOS's `._` companions, are not looked at.

    Of several files for one map a file of its own is read before gloss (for roughness) and DirectX's normals, and
    these before a channel of a packed file; of variants, numbered alike, the lowest number. Raises `InputError` if
    there are still several, for a folder that is missing, and, if one is `needed`, for one without a map.
    """
    folder = Path(folder)
    paths = _pictures(folder)
    names = {path: name for path in paths if (name := read_name(path.stem))}
    maps = {}
    for map_name in MAPS:
        offers = [
            Offer(path, name, part) for path, name in names.items() for part in name.parts if part.map == map_name
        ]
        offers = _lowest_numbers(offer for offer in offers if offer.rank == min(other.rank for other in offers))
        if len(offers) > 1:
            files = " and ".join(offer.path.name for offer in offers)
            raise InputError(f"{folder}: {files} could each be the {map_name}; leave one of them")
        if offers:
            maps[map_name] = offers[0]
    if needed and not maps:
        raise InputError(f"{folder}: holds no map{_instead(folder)}; name files {_all_words()}")
    used = {offer.path for offer in maps.values()}
    left = [path for path in paths if path not in used and not _shows_material(path, path in names, used)]
    return Choice(maps, tuple(path.name for path in left))


def _pictures(folder: Path) -> list[Path]:
    try:
        listing = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"{folder}: not a readable folder ({error.strerror}); give one that holds maps") from error
    return [path for path in listing if path.suffix.lower() in suffixes() and not path.name.startswith(".")]


def _lowest_numbers(offers: Iterable[Offer]) -> list[Offer]:
    """Without the variants of a higher number than others of the same word and asset."""
    offers = list(offers)
    alike = {(offer.name.asset, offer.name.word): [] for offer in offers}
    for offer in offers:
        alike[offer.name.asset, offer.name.word].append(offer.name.number)
    return [offer for offer in offers if offer.name.number == min(alike[offer.name.asset, offer.name.word])]


def _shows_material(path: Path, is_map: bool, used: set[Path]) -> bool:
    """A preview: named so, or as the asset whose name the maps begin with, as ambientCG's."""
    if is_map:
        return False
    begun = re.compile(re.escape(path.stem.lower()) + SEPARATOR)
    return is_preview(path.stem) or any(begun.match(other.name.lower()) for other in used)


def _instead(folder: Path) -> str:
    """Where the maps may be instead: archives often hold them in a folder of their own."""
    inner = [path.name for path in sorted(folder.iterdir()) if path.is_dir() and not path.name.startswith(".")]
    return f" (its folders are {', '.join(inner[:5])})" if inner else ""


def _all_words() -> str:
    words = {name: [w for w, parts in WORDS.items() if [part.map for part in parts] == [name]] for name in MAPS}
    listed = "; ".join(f"{name}: {', '.join(found)}" for name, found in words.items())
    packed = ", ".join(word for word, parts in WORDS.items() if len(parts) > 1)
    return f"(AnyName_)WORD(_2k).png with one of the words {listed}; several maps: {packed}"
