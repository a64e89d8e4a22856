"""Values of MaterialX nodes as maps: of image, tiledimage, normalmap, constant, multiply and mix, and no others.

A value is float32 `[height, width, channels]`, `[1, 1, channels]` where it is constant.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from skimage.transform import resize

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image

if TYPE_CHECKING:
    import MaterialX as mx

CHANNELS = {"float": 1, "color3": 3, "vector3": 3, "color4": 4, "vector2": 2}
_SPACES = {"srgb_texture": "srgb", "lin_rec709": "linear", "none": "linear", "raw": "linear", "": "linear"}
_LARGEST = 16384  # texels along a side


class Reader:
    """Of one document. Raises `InputError` that names the node for what it does not read."""

    def __init__(self, path: Path):
        self.path = path
        self._values: dict[str, np.ndarray] = {}

    def refuse(self, element: "mx.Element", reason: str) -> InputError:
        return InputError(f"{self.path}: node {element.getNamePath()} ({element.getCategory()}): {reason}")

    def input(self, node: "mx.Node", name: str) -> np.ndarray | None:
        """None: the geometry's own, as normals have it by default."""
        given = node.getInput(name)
        if given is None:
            definition = node.getNodeDef("", True)  # also where an input is one that it does not have
            given = definition and definition.getActiveInput(name)
            if given is None:
                raise self.refuse(node, f"there is no input {name}")
        elif (source := self._source(node, given)) is not None:
            return self._converted(node, self.node(source), given.getType())
        while given.hasInterfaceName() and given.getInterfaceInput() is not None:
            given = given.getInterfaceInput()
        return self._constant(node, given)

    def node(self, node: "mx.Node") -> np.ndarray:
        path = node.getNamePath()
        if path not in self._values:
            read = getattr(self, f"read_{node.getCategory()}", None)
            if read is None:
                raise self.refuse(node, f"not read; there are {', '.join(NODES)}")
            self._values[path] = self._converted(node, read(node), node.getType())
        return self._values[path]

    def _source(self, node: "mx.Node", given: "mx.Input") -> "mx.Node | None":
        """The node that an input is connected to, through graphs and their interfaces."""
        while given.hasInterfaceName() and given.getInterfaceInput() is not None:
            given = given.getInterfaceInput()
        source = given.getConnectedNode()
        connected = any(given.hasAttribute(name) for name in ("nodename", "nodegraph", "output"))
        if source is None and connected:
            raise self.refuse(node, f"input {given.getName()} is connected to what is not there")
        return source

    def _constant(self, node: "mx.Node", given: "mx.Input") -> np.ndarray | None:
        kind, text = given.getType(), given.getValueString()
        if kind not in CHANNELS:
            raise self.refuse(node, f"input {given.getName()} is a {kind}, which is not read")
        if not text:
            return None
        values = np.array([float(part) for part in text.split(",")], np.float32)
        if len(values) != CHANNELS[kind]:
            raise self.refuse(node, f"input {given.getName()} holds {text!r}, which is no {kind}")
        return values[None, None]

    def _converted(self, node: "mx.Node", value: np.ndarray, kind: str) -> np.ndarray:
        """To the channels of a type: of images, the first ones, grey to all of a colour."""
        count = CHANNELS.get(kind)
        if count is None:
            raise self.refuse(node, f"gives a {kind}, which is not read")
        if value.shape[-1] == 1 and kind != "float":
            return np.repeat(value, count, axis=-1)
        if value.shape[-1] < count:
            raise self.refuse(node, f"has {value.shape[-1]} channels where a {kind} is wanted")
        return value[..., :count]

    def read_image(self, node: "mx.Node") -> np.ndarray:
        file = node.getInput("file")
        while file is not None and file.hasInterfaceName() and file.getInterfaceInput() is not None:
            file = file.getInterfaceInput()
        name = "" if file is None else file.getResolvedValueString()
        if not name:
            raise self.refuse(node, "names no file")
        self._check_place(node)
        space = file.getActiveColorSpace()
        if space not in _SPACES:
            raise self.refuse(node, f"colour space {space} is not read; convert to srgb_texture or lin_rec709")
        is_color = node.getType().startswith("color")
        return load_image(self._find(name), color_space=_SPACES[space] if is_color else "linear")

    def _find(self, name: str) -> Path:
        """Beside the document, or in a folder above, as the paths of MaterialX's own library are."""
        places = [folder / name for folder in self.path.absolute().parents]
        return next((place for place in places if place.is_file()), self.path.parent / name)

    def _check_place(self, node: "mx.Node") -> None:
        texcoord = node.getInput("texcoord")
        source = texcoord and texcoord.getConnectedNode()
        if source is not None and source.getCategory() != "texcoord":
            raise self.refuse(source, "places textures, which is not read; use tiledimage's uvtiling")
        for name, usual in (("uaddressmode", "periodic"), ("vaddressmode", "periodic"), ("layer", "")):
            given = node.getInput(name)
            if given is not None and given.getValueString() not in (usual, ""):
                raise self.refuse(node, f"{name} {given.getValueString()} is not read; maps repeat")

    def read_tiledimage(self, node: "mx.Node") -> np.ndarray:
        for name, usual in (("uvoffset", 0.0), ("realworldimagesize", 1.0), ("realworldtilesize", 1.0)):
            if (self.input(node, name) != usual).any():
                raise self.refuse(node, f"{name} is not read; leave it {usual:g}")
        image, (across, up) = self.read_image(node), self.input(node, "uvtiling")[0, 0]
        sizes = np.array(image.shape[:2]) * (up, across)
        if not (across >= 1 and up >= 1 and across % 1 == up % 1 == 0 and sizes.max() <= _LARGEST):
            raise self.refuse(node, f"uvtiling {across:g}, {up:g} is not read; make it whole, to {_LARGEST} texels")
        return np.tile(image, (int(up), int(across), 1))

    def read_normalmap(self, node: "mx.Node") -> np.ndarray:
        for name in ("normal", "tangent", "bitangent"):
            source = node.getInput(name) and node.getInput(name).getConnectedNode()
            if source is not None and source.getCategory() != name:
                raise self.refuse(node, f"{name} is not the geometry's own, which is not read")
        decoded = self.input(node, "in") * 2 - 1
        decoded[..., :2] *= self.input(node, "scale")
        decoded[..., 2] = np.maximum(decoded[..., 2], 0.05)  # above the surface
        return decoded / np.linalg.norm(decoded, axis=-1, keepdims=True)

    def read_constant(self, node: "mx.Node") -> np.ndarray:
        return self.input(node, "value")

    def read_multiply(self, node: "mx.Node") -> np.ndarray:
        a, b = of_one_size(self.input(node, "in1"), self.input(node, "in2"))
        return a * b

    def read_mix(self, node: "mx.Node") -> np.ndarray:
        fg, bg, share = of_one_size(*(self.input(node, name) for name in ("fg", "bg", "mix")))
        return bg + (fg - bg) * share


NODES = ("image", "tiledimage", "normalmap", "constant", "multiply", "mix")


def of_one_size(*values: np.ndarray) -> list[np.ndarray]:
    """Smaller maps are enlarged to the largest sides; constants stay as they are."""
    height, width = (max(value.shape[axis] for value in values) for axis in (0, 1))
    return [
        value
        if value.shape[:2] in ((1, 1), (height, width))
        else resize(value, (height, width), order=1, mode="wrap").astype(np.float32)
        for value in values
    ]
