"""What a layered material is made of: its inputs, and which of them are maps."""

from dataclasses import dataclass

from warp_neural.kernels.errors import require

INPUTS: dict[str, tuple[float, ...]] = {
    # the base: diffuse under a dielectric, or metal
    "color": (0.5, 0.5, 0.5),  # linear: of the diffuse, or of the metal at normal incidence
    "normal": (0.0, 0.0, 1.0),  # y UP the picture, as all normals
    "roughness": (0.5,),  # perceptual: GGX's alpha is its square
    "metalness": (0.0,),
    "specular": (0.5,),  # 1 reflects 8 % at normal incidence, 0.5 as an index of refraction of 1.5
    "diffuse_roughness": (0.0,),
    "anisotropy": (0.0,),  # 1: facets vary along the tangent only, across the strokes of a brush
    "tangent": (1.0, 0.0),  # cosine and sine of TWICE the tangent's angle from x: maps of it may be averaged
    # the coat, a dielectric
    "coat": (0.0,),  # its share of the surface
    "coat_normal": (0.0, 0.0, 1.0),
    "coat_roughness": (0.1,),
    "coat_specular": (0.5,),
    "coat_color": (1.0, 1.0, 1.0),  # what it lets through at normal incidence, there and back
    # fingerprints, on the coat, and on the base where there is none
    "fingerprints": (0.0,),
    "fingerprint_roughness": (0.45,),
    # dust on top of all
    "dust": (0.0,),
    "dust_color": (0.45, 0.41, 0.36),
    "dust_roughness": (1.0,),
}
"""Each input's value where nothing else is said; its length is the number of channels. All but normals and tangents
are in [0, 1], `specular`s to 12.5."""

LAYERS = {"coat": "coat", "dust": "dust", "fingerprints": "fingerprints", "anisotropic": "anisotropy"}
"""Parts of a spec, and the input that is their share: without it no code is made for them."""


_FIRST = {"coat": ("coat",), "dust": ("dust",), "fingerprints": ("fingerprint",), "anisotropic": ("aniso", "tangent")}


def inputs_of(layer: str) -> tuple[str, ...]:
    """Names of the inputs that only this layer has."""
    return tuple(name for name in INPUTS if name.startswith(_FIRST[layer]))


@dataclass(frozen=True)
class LayeredSpec:
    """What code is made for. maps: the inputs read from textures, in the order of `INPUTS`; others are constants of
    each material."""

    maps: tuple[str, ...] = ()
    coat: bool = False
    dust: bool = False
    fingerprints: bool = False
    anisotropic: bool = False

    def __post_init__(self) -> None:
        known = tuple(name for name in INPUTS if name in self.maps)
        require(self.maps == known, "maps", self.maps, f"names in this order: {', '.join(INPUTS)}")
        for layer, share in LAYERS.items():
            require(getattr(self, layer) or share not in self.maps, layer, False, f"True, as {share} is a map")


def channels(name: str) -> int:
    return len(INPUTS[name])


def place(name: str) -> int:
    """The first of the input's channels among all inputs' ones."""
    before = list(INPUTS)[: list(INPUTS).index(name)]
    return sum(map(channels, before))


CHANNELS = sum(map(channels, INPUTS))
