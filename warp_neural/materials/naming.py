"""Which map a file holds, by its name: one table of the words of all naming schemes.

Schemes: [A] ambientCG, the names of its downloads (NormalGL and NormalDX side by side); [P] Poly Haven,
docs.polyhaven.com, "Technical Standards: Textures" (nor_gl, nor_dx, arm; col_01, col_02 for variants); [S] Adobe
Substance 3D Painter's export presets (PBR Metallic Roughness; Unreal Engine packed; Unity HD and Universal; Document
channels with Normal_OpenGL and Mixed_AO); [Q] Quixel Megascans, help.quixel.com, article 115000612165, and the names of
its downloads; [F] FreePBR's downloads (normal-ogl, normal-dx); [T] TextureCan's (normal_opengl, normal_directx); [G]
glTF 2.0, 3.9.2 and 3.9.3: R occlusion, G roughness, B metalness; [U] Unreal Engine, the names of Epic's own textures
(T_Name_D, _N, _ORM; normals are DirectX's); [L] Poliigon, help.poliigon.com, "Texture Maps Explained" (COL, NRM, GLOSS,
DISP; VAR1 for variants); plain: our own, one word a map.
"""

import re
from dataclasses import dataclass

RED, GREEN, BLUE, ALPHA, GREY = 0, 1, 2, 3, None


@dataclass(frozen=True)
class Part:
    """One map in a file."""

    map: str
    channel: int | None = GREY
    """the one channel it is; None: all of them, averaged where the map is grey"""
    inverted: bool = False
    """1 minus the map: gloss for roughness"""
    directx: bool = False
    """a normal map whose green points down the picture"""


def _packed(red: str | None, green: str, blue: str | None) -> tuple[Part, ...]:
    channels = ((red, RED), (green, GREEN), (blue, BLUE))
    return tuple(Part(name, channel) for name, channel in channels if name)


_ORM = _packed("ao", "roughness", "metalness")
_SMOOTH_ALPHA = Part("roughness", ALPHA, inverted=True)

WORDS: dict[str, tuple[Part, ...]] = {
    # "_" stands for a space, dot, hyphen, underscore or nothing; where it is missing the word is written as one
    **dict.fromkeys(("albedo", "color", "colour"), (Part("albedo"),)),  # plain Q F; A T; plain
    **dict.fromkeys(("base_color", "base_map", "diffuse", "diff"), (Part("albedo"),)),  # S L G; S (Unity); S; P
    **dict.fromkeys(("col", "albedo_transparency"), (Part("albedo"),)),  # P L; S (Unity)
    **dict.fromkeys(("normal", "nrm"), (Part("normal"),)),  # plain S Q G, L: taken as OpenGL's
    **dict.fromkeys(("normal_gl", "normal_ogl", "normal_opengl", "nor_gl"), (Part("normal"),)),  # A F T S P
    **dict.fromkeys(("normal_dx", "normal_directx", "nor_dx"), (Part("normal", directx=True),)),  # A F, T S, P
    **dict.fromkeys(("roughness", "rough"), (Part("roughness"),)),  # plain A S Q F T L; P
    **dict.fromkeys(("gloss", "glossiness", "smoothness"), (Part("roughness", inverted=True),)),  # Q L; S; S (Unity)
    **dict.fromkeys(("metalness", "metallic", "metal"), (Part("metalness"),)),  # plain A Q L; S F T; P
    **dict.fromkeys(("ambient_occlusion", "ao", "mixed_ao", "occlusion"), (Part("ao"),)),  # A L; plain P Q F T; S; G
    **dict.fromkeys(("displacement", "disp", "height"), (Part("height"),)),  # A Q; P L; plain S F T
    **dict.fromkeys(("opacity", "alpha"), (Part("opacity"),)),  # plain A S Q T; P
    **dict.fromkeys(("arm", "orm"), _ORM),  # P; U S
    **dict.fromkeys(("occlusion_roughness_metallic", "occlusionroughmetal"), _ORM),  # S G; Khronos' sample models
    **dict.fromkeys(("metallicroughness", "metalroughness"), _packed(None, "roughness", "metalness")),  # G
    "metallicsmoothness": (Part("metalness", RED), _SMOOTH_ALPHA),  # S (Unity Universal)
    "maskmap": (Part("metalness", RED), Part("ao", GREEN), _SMOOTH_ALPHA),  # S (Unity HD)
}

_UNREAL = {"d": WORDS["diff"], "bc": WORDS["diff"], "n": WORDS["nor_dx"], "r": WORDS["rough"], "orm": _ORM}
"""Only after a name that begins with T_: single letters mean nothing elsewhere."""

SEPARATOR = "[ ._-]"
_PATTERN = {word: re.compile(rf"(?:^|{SEPARATOR}){word.replace('_', f'{SEPARATOR}?')}$") for word in WORDS}
_SIZE = re.compile(rf"{SEPARATOR}+(\d+k|\d{{3,5}}(x\d{{3,5}})?|jpe?g|png|exr|tiff?|lod\d)$")
_WORKFLOW = re.compile(rf"({SEPARATOR}\d+k){SEPARATOR}(metalness|specular)$")  # L: Bricks_COL_2K_METALNESS
_NUMBER = re.compile(rf"{SEPARATOR}?(?:var)?(\d{{1,2}})$")  # P: col_01, L: COL_VAR1
_PREVIEW = re.compile(r"(^|[ ._-])(preview|thumb|thumbnail|render|sphere|cover)([ ._-]?\d*)?$")


@dataclass(frozen=True)
class Name:
    """What a file's name says."""

    word: str
    parts: tuple[Part, ...]
    asset: str
    """what stands before the word"""
    number: int
    """of a variant; -1 for none"""


def read_name(stem: str) -> Name | None:
    """What a file of this name, without its suffix, holds; None for no map. Case does not count.

    The longest word at the end is taken, before sizes such as _2k, _4096 or _2K-JPG and the number of a variant.
    """
    stem = stem.lower()
    workflow = _WORKFLOW.search(stem)
    if workflow and (name := _without_size(stem[: workflow.end(1)])):
        return name
    return _without_size(stem)


def is_preview(stem: str) -> bool:
    """A picture of the material, by its name."""
    return bool(_PREVIEW.search(_without_sizes(stem.lower())))


def _without_sizes(stem: str) -> str:
    while size := _SIZE.search(stem):
        stem = stem[: size.start()]
    return stem


def _without_size(stem: str) -> Name | None:
    stem = _without_sizes(stem)
    name = _word_at_end(stem, -1)
    number = _NUMBER.search(stem)
    return name or (_word_at_end(stem[: number.start()], int(number[1])) if number else None)


def _word_at_end(stem: str, number: int) -> Name | None:
    found = [(match, word) for word, pattern in _PATTERN.items() if (match := pattern.search(stem))]
    if found:
        match, word = min(found, key=lambda item: item[0].start())
        return Name(word, WORDS[word], stem[: match.start()], number)
    asset, _, letter = stem.rpartition("_")
    if stem.startswith("t_") and letter in _UNREAL:
        return Name(letter, _UNREAL[letter], asset, number)
    return None
