"""The commands of textures with a codec that stands aside: what is asked of it is kept, and a texture that holds its
source exactly comes back."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from warp_neural import texture
from warp_neural.errors import InputError
from warp_neural.imaging.image import save_image
from warp_neural.io.files import atomic_path
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.maps import TextureSet, mip_chain
from warp_neural.texture.state import Tensor, TextureState

RNG = np.random.default_rng(11)


@dataclass
class Exact:
    """A texture without losses, in place of a codec's."""

    source: TextureSet
    mips: int
    metrics: dict = field(default_factory=lambda: {"psnr": 99.0})

    @property
    def state(self):
        height, width = self.source.size
        spec = TextureSpec(height, width, self.source.channels, self.mips, (Grid(4, 2),), (8,))
        latents = tuple((np.zeros((*spec.cells(mip, 0), 2), np.int8),) for mip in range(self.mips))
        tensors = {name: Tensor(np.zeros(shape, np.int32), 0.5) for name, shape in spec.tensors.items()}
        return TextureState(spec, latents, tensors, self.source.maps)

    def save(self, path):
        with atomic_path(path) as temporary:
            temporary.write_bytes(bytes(100))
        return {"latents": [[50], [10]][: self.mips], "network": 40, "all": 100}

    def decode(self, mip=0, rectangle=None):
        values = mip_chain(self.source)[mip]
        if rectangle:
            x, y, w, h = rectangle
            values = values[y : y + h, x : x + w]
        return to_maps(values, self.source.maps)


@pytest.fixture
def codec(tmp_path, monkeypatch):
    """A working folder with a material, and the calls of the codec that are kept."""
    wp.init()  # what Warp says of the machine, it says once
    monkeypatch.chdir(tmp_path)
    albedo, normal = RNG.integers(0, 256, (2, 6, 9, 3)) / 255
    save_image("rock/albedo.png", albedo, color_space="linear")
    save_image("rock/normal.png", normal, color_space="linear")
    save_image("rock/sky.exr", 50 * RNG.random((6, 9, 3)))
    save_image("rock/ao.png", np.ones((6, 9)), color_space="linear")
    calls, made = [], {}

    def compress(source, **options):
        calls.append(options)
        made["texture"] = Exact(source, options["mips"])
        return made["texture"]

    def load(path, device=None):
        if not Path(path).is_file():
            raise InputError(f"{path}: no such file; give a neural texture")
        return made["texture"]

    monkeypatch.setattr(texture, "compress", compress, raising=False)
    monkeypatch.setattr(texture, "load", load, raising=False)
    return calls
