"""MaterialX documents as layered materials: `open_pbr_surface` and `standard_surface`."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warp_neural.errors import InputError
from warp_neural.materials.layered import LayeredMaterial
from warp_neural.materials.materialx_nodes import Reader, of_one_size

if TYPE_CHECKING:
    import MaterialX as mx

_SHADERS = {
    "open_pbr_surface": {
        "weight": "base_weight",
        "color": "base_color",
        "diffuse_roughness": "base_diffuse_roughness",
        "metalness": "base_metalness",
        "specular": "specular_weight",
        "specular_color": "specular_color",
        "ior": "specular_ior",
        "roughness": "specular_roughness",
        "anisotropy": "specular_roughness_anisotropy",
        "coat": "coat_weight",
        "coat_color": "coat_color",
        "coat_roughness": "coat_roughness",
        "coat_ior": "coat_ior",
        "normal": "geometry_normal",
        "coat_normal": "geometry_coat_normal",
    },
    "standard_surface": {
        "weight": "base",
        "color": "base_color",
        "diffuse_roughness": "diffuse_roughness",
        "metalness": "metalness",
        "specular": "specular",
        "specular_color": "specular_color",
        "ior": "specular_IOR",
        "roughness": "specular_roughness",
        "anisotropy": "specular_anisotropy",
        "rotation": "specular_rotation",
        "coat": "coat",
        "coat_color": "coat_color",
        "coat_roughness": "coat_roughness",
        "coat_ior": "coat_IOR",
        "normal": "normal",
        "coat_normal": "coat_normal",
    },
}
"""What we call an input, and what the shader does."""

_ABSENT = {
    "open_pbr_surface": {
        **dict.fromkeys(("transmission_weight", "subsurface_weight", "fuzz_weight", "thin_film_weight"), 0.0),
        **{"emission_luminance": 0.0, "geometry_opacity": 1.0},
    },
    "standard_surface": {
        **dict.fromkeys(("transmission", "subsurface", "sheen", "thin_film_thickness", "emission"), 0.0),
        **{"coat_affect_color": 0.0, "coat_affect_roughness": 0.0, "opacity": 1.0},
    },
}
"""Inputs that must keep what leaves their layer out."""


def load_materialx(path: Path | str, material: str | None = None) -> LayeredMaterial:
    """A document's material, which must be named where it has several. Needs `pip install 'warp-neural[materialx]'`.

    Read are `open_pbr_surface` and `standard_surface`, of constants and the nodes of `Reader`; normals in tangent
    space; files beside the document or, as in MaterialX's own library, from a folder above. Specular colours count by
    their mean, coats are isotropic and do not darken, metals reflect by Schlick's formula. Raises `InputError` for
    files that are none, and, by name, for layers, nodes and inputs that are not read.
    """
    path = Path(path)
    document = _read(path)  # nodes are of one only as long as it is held
    name, shader = _find_shader(path, document, material)
    kind, reader = shader.getCategory(), Reader(path)
    if kind not in _SHADERS:
        raise reader.refuse(shader, f"not read; there are {', '.join(_SHADERS)}")
    for absent, value in _ABSENT[kind].items():
        if (reader.input(shader, absent) != value).any():
            raise reader.refuse(shader, f"input {absent} is not read; leave it {value:g}")
    for given in shader.getInputs():
        if given.getName().endswith("tangent") or not shader.getNodeDef("", True).getActiveInput(given.getName()):
            raise reader.refuse(shader, f"input {given.getName()} is not read; leave it out")
    values = {ours: reader.input(shader, theirs) for ours, theirs in _SHADERS[kind].items()}
    return LayeredMaterial(name, _inputs(values))


def _inputs(values: dict[str, np.ndarray | None]) -> dict[str, np.ndarray | tuple[float, ...]]:
    color, weight = of_one_size(values["color"], values["weight"])
    specular, tint = of_one_size(values["specular"], values["specular_color"].mean(axis=-1, keepdims=True))
    inputs = {
        "color": color * weight,
        "specular": specular * tint * _specular(values["ior"]),
        "coat_specular": _specular(values["coat_ior"]),
    }
    if "rotation" in values:
        angle = 4 * np.pi * values["rotation"]
        inputs["tangent"] = np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)
    taken = ("weight", "specular_color", "ior", "coat_ior", "rotation")
    inputs = {**{k: v for k, v in values.items() if k not in taken and v is not None}, **inputs}
    return {k: tuple(v[0, 0].tolist()) if v.shape[:2] == (1, 1) else v for k, v in inputs.items()}


def _specular(ior: np.ndarray) -> np.ndarray:
    """As 0.08 of the light at normal incidence is 1."""
    return ((ior - 1) / (ior + 1)) ** 2 / 0.08


def _read(path: Path) -> "mx.Document":
    try:
        import MaterialX as mx
    except ImportError as error:
        raise InputError(f"{path}: reading MaterialX needs pip install 'warp-neural[materialx]'") from error
    document, library = mx.createDocument(), mx.createDocument()
    try:
        mx.readFromXmlFile(document, str(path))
    except Exception as error:  # its own classes, which derive from Exception alone
        raise InputError(f"{path}: not a readable MaterialX document ({error})") from error
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document.importLibrary(library)
    return document


def _find_shader(path: Path, document: "mx.Document", material: str | None) -> tuple[str, "mx.Node"]:
    own = [node for node in document.getMaterialNodes() if not node.hasSourceUri()]
    names = [node.getName() for node in own]
    if material is not None and material not in names:
        raise InputError(f"{path}: has no material {material}; there are {', '.join(names) or 'none'}")
    if not own:
        raise InputError(f"{path}: has no material; add a surfacematerial")
    if material is None and len(own) > 1:
        raise InputError(f"{path}: has several materials; choose one of {', '.join(names)}")
    chosen = own[names.index(material) if material else 0]
    given = chosen.getInput("surfaceshader")
    shader = given and given.getConnectedNode()
    if shader is None:
        raise InputError(f"{path}: material {chosen.getName()} has no surface shader")
    return chosen.getName(), shader
