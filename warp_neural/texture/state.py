"""All that makes a neural texture, as data: between training, files and devices."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import BlockSpec, TextureSpec

Kind = Literal["srgb", "linear", "normal", "mask", "hdr"]


@dataclass(frozen=True)
class Tensor:
    """Parameters in the file: integers times one step."""

    integers: np.ndarray
    """int32, of the shape in `TextureSpec.tensors`"""
    step: float
    """a float16 number"""

    @property
    def values(self) -> np.ndarray:
        """float32."""
        return (self.integers * np.float64(self.step)).astype(np.float32)


@dataclass(frozen=True)
class Map:
    """One map of a texture set and what its channels mean; see `warp_neural.texture.maps`.

    kind: srgb, colour as stored, encoded; linear, data; normal, tangent space, stored as (x + 1) / 2; mask, one channel
    of 0 and 1; hdr, of any positive size, which the network has as logarithms. low, high: of each channel as stored,
    which the network has as 0 and 1, log2(x + 2^low) of hdr; where they are equal the channel is constant, exact, that
    value itself (of hdr too), and no result of the network.
    """

    name: str
    kind: Kind
    low: tuple[float, ...]
    high: tuple[float, ...]
    file: str = ""
    """that it came from"""
    bits: int = 8
    """of a channel of a PNG of it: 8 or 16"""

    @property
    def channels(self) -> int:
        return len(self.low)

    @property
    def trained(self) -> tuple[int, ...]:
        """Which channels are results of the network."""
        return tuple(c for c in range(self.channels) if self.low[c] != self.high[c])

    @property
    def span(self) -> tuple[float, float]:
        """The least low and the largest high of the channels that vary, of all where none does."""
        channels = self.trained or range(self.channels)
        return min(self.low[c] for c in channels), max(self.high[c] for c in channels)


@dataclass(frozen=True)
class TextureState:
    """latents: int8 [rows, columns, channels] of each mip and grid. tensors: by the names of `TextureSpec.tensors`.
    maps: in the order of their channels. extra: JSON that stays with the file, such as errors measured."""

    spec: TextureSpec
    latents: tuple[tuple[np.ndarray, ...], ...]
    tensors: Mapping[str, Tensor]
    maps: tuple[Map, ...]
    extra: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        spec = self.spec
        for mip in range(spec.mips):
            for g, grid in enumerate(spec.grids):
                latents, shape = self.latents[mip][g], (*spec.cells(mip, g), grid.channels)
                fits = latents.shape == shape and latents.dtype == np.int8
                if not fits or max(int(latents.max()), -int(latents.min())) > grid.limit:
                    raise InputError(f"latents of mip {mip}, grid {g}: expected int8 {shape} up to {grid.limit}")
        check_parts(spec, self.tensors, self.maps)


def check_parts(spec: TextureSpec | BlockSpec, tensors: Mapping[str, Tensor], maps: tuple[Map, ...]) -> None:
    """Raises `InputError` for tensors that are missing or of other shapes, and maps of other channels."""
    for name, shape in spec.tensors.items():
        if name not in tensors or tensors[name].integers.shape != shape:
            raise InputError(f"{name}: expected a tensor of shape {shape}")
    trained = sum(len(each.trained) for each in maps)
    if trained != spec.channels:
        raise InputError(f"maps: they have {trained} channels that vary, the network has {spec.channels} results")
