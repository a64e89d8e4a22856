"""Layered materials: coat, specular and diffuse base, dust and fingerprints, from maps and constants."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.errors import LARGEST, require
from warp_neural.kernels.materials.layered import make_layered
from warp_neural.kernels.materials.spec import INPUTS, LAYERS, LayeredSpec, inputs_of
from warp_neural.kernels.materials.textures import LayeredParams
from warp_neural.materials.energy import energy_tables
from warp_neural.materials.material import Material
from warp_neural.materials.pyramid import Pyramid, pyramid

_LARGEST = {"specular": 12.5, "coat_specular": 12.5}  # as mirrors; other inputs end at 1
_SIGNED = ("normal", "coat_normal", "tangent")

InputValue = np.ndarray | float | tuple[float, ...]


@dataclass(frozen=True)
class LayeredMaterial:
    """Inputs of a layered material by their names in `kernels.materials.spec.INPUTS`, which has their defaults.

    A number or a tuple is a constant; an array is a map, `[height, width]` or `[height, width, channels]`, of any size,
    its first row the top of the picture. Maps repeat, and may be of different sizes. Raises `InputError` for names,
    shapes and values that are none.
    """

    name: str
    inputs: Mapping[str, InputValue] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checked = {name: _checked(self.name, name, value) for name, value in self.inputs.items()}
        object.__setattr__(self, "inputs", checked)

    @property
    def maps(self) -> tuple[str, ...]:
        """Names of the inputs that are maps."""
        return tuple(name for name in INPUTS if np.ndim(self.inputs.get(name, 0.0)) == 3)

    @property
    def layers(self) -> dict[str, bool]:
        """Which layers there are: those whose share is not zero everywhere."""
        return {layer: bool(np.any(self.inputs.get(share, 0.0))) for layer, share in LAYERS.items()}

    def value(self, name: str) -> np.ndarray:
        """`[height, width, channels]` of a map, `[channels]` of a constant."""
        return self.inputs.get(name, np.array(INPUTS[name], np.float32))


class LayeredSet:
    """Layered materials for kernels, on one device: any thread may call them, each with an index of its own.

        materials = LayeredSet(deluxe_material(), from_material(load_material("Leather034C")))
        materials.evaluate(params, index, uv, lod, light, view)   # in kernels; params: materials.Params

    The functions are `LayeredFunctions`; `params` goes to launches; `texels` are the sides that levels of detail count
    from, of each material's largest map. One code serves all: what is a map in one material
    is one of a single texel in the others. Maps of constant zeros for a layer's share leave the layer out.
    """

    Params = LayeredParams

    def __init__(self, *materials: LayeredMaterial, device: wp.DeviceLike = None):
        if not materials:
            raise InputError("a set of no layered materials; give one or more")
        self.materials = materials
        self.device = wp.get_device(device)
        self.spec = _common_spec(materials)
        functions = make_layered(self.spec)
        self.evaluate, self.sample, self.density = functions.evaluate, functions.sample, functions.density
        self.albedo, self.parameters = functions.albedo, functions.parameters
        self.texels = [max([1, *(max(m.value(name).shape[:2]) for name in m.maps)]) for m in materials]
        self.params = self._make_params()

    def __len__(self) -> int:
        return len(self.materials)

    def __repr__(self) -> str:
        return f"LayeredSet({', '.join(material.name for material in self.materials)}; {len(self.spec.maps)} maps)"

    def _make_params(self) -> LayeredParams:
        constants = [np.concatenate([_mean(m.value(name)) for name in INPUTS]) for m in self.materials]
        pyramids = [[pyramid(_as_map(m.value(name))) for name in self.spec.maps] for m in self.materials]
        levels, texels = _packed([p for row in pyramids for p in row])
        params = LayeredParams()
        params.constants = wp.array(np.stack(constants), dtype=float, device=self.device)
        params.texels = wp.array(texels, dtype=float, device=self.device)
        params.levels = wp.array(levels, dtype=wp.vec3i, device=self.device)
        params.finer = wp.array(np.concatenate([_finer(row) for row in pyramids]), dtype=float, device=self.device)
        params.energy = energy_tables(str(self.device), self.spec.anisotropic)
        return params


def from_material(material: Material) -> LayeredMaterial:
    """A base of a folder's maps, without other layers. Occlusion is not used, as renderers find it themselves, nor are
    height and opacity."""
    maps = {"color": material.albedo, "normal": material.normal}
    return LayeredMaterial(material.name, {**maps, "roughness": material.roughness, "metalness": material.metalness})


def _checked(material: str, name: str, value: InputValue) -> np.ndarray:
    if name not in INPUTS:
        raise InputError(f"layered material {material}: no input {name}; there are {', '.join(INPUTS)}")
    array, count = np.asarray(value, np.float32), len(INPUTS[name])
    if count == 1 and array.ndim in (0, 2):
        array = array[..., None]
    if array.ndim not in (1, 3) or array.shape[-1] != count or not array.size:
        raise InputError(
            f"layered material {material}: {name} has shape {np.shape(value)}; "
            f"give {count} number{'s' * (count > 1)}, or a map [height, width, {count}]"
        )
    low, high = -1.0 if name in _SIGNED else 0.0, _LARGEST.get(name, 1.0)
    if not (array.min() >= low - 1e-5 and array.max() <= high + 1e-5):
        raise InputError(
            f"layered material {material}: {name} has values from {array.min():.6g} to {array.max():.6g}; "
            f"bring them into {low:g} to {high:g}"
        )
    return np.clip(array, low, high)


def _common_spec(materials: tuple[LayeredMaterial, ...]) -> LayeredSpec:
    """Of which each material is a case."""
    layers = {layer: any(m.layers[layer] for m in materials) for layer in LAYERS}
    unused = {name for layer in LAYERS if not layers[layer] for name in inputs_of(layer)}
    maps = tuple(name for name in INPUTS if name not in unused and any(name in m.maps for m in materials))
    return LayeredSpec(maps, **layers)


def _as_map(value: np.ndarray) -> np.ndarray:
    return value if value.ndim == 3 else value[None, None]


def _mean(value: np.ndarray) -> np.ndarray:
    return value if value.ndim == 1 else value.mean(axis=(0, 1))


def _finer(pyramids: list[Pyramid]) -> np.ndarray:
    """How many levels smaller than the largest each map is, by its longer side."""
    sides = np.array([max(p[0].shape[:2]) for p in pyramids], np.float32)
    return np.log2(sides.max(initial=1.0) / sides)


def _packed(pyramids: list[Pyramid]) -> tuple[np.ndarray, np.ndarray]:
    """`levels` and `texels` of `LayeredParams`."""
    size = sum(image.size for images in pyramids for image in images)
    require(size < LARGEST, "materials", size, f"fewer than {LARGEST} numbers in all maps; make them smaller")
    count = max(map(len, pyramids), default=1)
    levels, start = np.ones((max(len(pyramids), 1), count, 3), np.int32), 0
    for row, images in enumerate(pyramids):
        for level in range(count):
            image = images[min(level, len(images) - 1)]
            if level < len(images):
                place, start = start, start + image.size
            levels[row, level] = place, *image.shape[:2]
    texels = [image.ravel() for images in pyramids for image in images]
    return levels, np.concatenate([*texels, np.zeros(1, np.float32)])
