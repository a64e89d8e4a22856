"""`Texture`: a neural texture on a device: whole maps, texels for kernels, files."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warp_neural.errors import find_device
from warp_neural.kernels.texture import filters
from warp_neural.kernels.texture.filtering import make_sample, make_sampler
from warp_neural.kernels.texture.texel import make_stored
from warp_neural.texture.decoder import Decoder
from warp_neural.texture.file import save_state
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.memory import bytes_of
from warp_neural.texture.state import TextureState


class Texture:
    """state: all that it is, on the host. In kernels that take `params: texture.Params`, launched with
    `texture.params`, any thread calls `texture.texel(params, i, j, mip)`, `texture.sample(params, uv, lod)` or a
    function that `texture.make_sampler` has made.

    `texture.channels` says where in their result each map's channels are: as stored (`Map`), without those that are
    constant.
    """

    def __init__(self, state: TextureState, device: wp.DeviceLike = None):
        self.state, self.device = state, find_device(device)

    def __repr__(self) -> str:
        spec, names = self.state.spec, ", ".join(each.name for each in self.state.maps)
        return f"Texture({names}, {spec.width} x {spec.height}, {spec.mips} mips, {self.device.alias})"

    @property
    def metrics(self) -> dict[str, Any]:
        """What was measured when it was made: PSNR in dB of mip 0, of each map and of each mip, seconds."""
        return dict(self.state.extra)

    def with_metrics(self, metrics: Mapping[str, Any]) -> "Texture":
        self.state = replace(self.state, extra=dict(metrics))
        return self

    @cached_property
    def decoder(self) -> Decoder:
        return Decoder(self.state, self.device)

    def decode(self, mip: int = 0, rectangle: tuple[int, int, int, int] | None = None) -> dict[str, np.ndarray]:
        """Each map as stored, float32 [height, width, channels]. rectangle: left, top, width, height, in texels."""
        return to_maps(self.decoder.decode(mip, rectangle), self.state.maps)

    def decode_to(self, values: wp.array, mip: int = 0, rectangle: tuple[int, int, int, int] | None = None) -> None:
        """All `channels` to memory of the device, as the network has them: 0 to 1 from a channel's low to its high end
        (`ranges`), not clamped. values: contiguous [height, width, channels] of float, on CUDA from sm_80 on also of
        `wp.float16`, or of `wp.uint8`, 0 to 255, clamped. Nothing is copied to the host; a CUDA graph can hold it after
        one call."""
        self.decoder.decode_to(values, mip, rectangle)

    def save(self, path: Path | str) -> dict[str, int]:
        """Write a .wntc file, whole or not at all; returns its bytes by part."""
        return save_state(path, self.state)

    @property
    def Params(self) -> Any:
        return self.decoder.Params

    @property
    def params(self) -> Any:
        return self.decoder.params

    @property
    def bytes(self) -> int:
        """Of latents, network and tables on the device."""
        return bytes_of(self.params)

    @cached_property
    def channels(self) -> dict[str, tuple[int, ...]]:
        """Of each map, where its channels are in a texel."""
        places, start = {}, 0
        for each in self.state.maps:
            places[each.name] = tuple(range(start, start + len(each.trained)))
            start += len(each.trained)
        return places

    @property
    def ranges(self) -> tuple[tuple[float, float, bool], ...]:
        """Of each channel: the numbers stored that the network has as 0 and 1, and whether these are logarithms."""
        return tuple((each.low[c], each.high[c], each.kind == "hdr") for each in self.state.maps for c in each.trained)

    @cached_property
    def texel(self) -> wp.Function:
        """`(params, i: int, j: int, mip: int) -> vec`: row i and column j, which wrap, of a level."""
        return make_stored(self.decoder.texel, self.ranges, self.Params)

    @cached_property
    def sample(self) -> wp.Function:
        """`(params, uv: vec2, lod: float) -> vec`: bilinear in the two levels beside `lod`, blended; eight texels.

        uv: (0, 0) is the upper left corner of the texture, (1, 1) the lower right one; wraps. Its gradients, by
        `wp.Tape`, go to uv and lod.
        """
        return make_sample(self.texel, self.state.spec, self.Params)

    def make_sampler(self, filter: wp.Function = filters.bilinear) -> wp.Function:
        """`(params, uv: vec2, footprint: mat22, random: vec4) -> vec`: one texel, drawn so that the mean of many draws
        is the filtered value (stochastic texture filtering); about an eighth of `sample`'s work.

        filter: of `wn.texture.filters`: nearest, bilinear, bicubic, gaussian(sigma), or a function of that kind.
        footprint: columns duv/dx and duv/dy of the pixel; it chooses the level, between two at random, and spreads
        draws along its major axis. All zeros is level 0; 2^lod / width and 2^lod / height on the diagonal is a level of
        detail. random: four numbers in [0, 1), as `wn.random.uniform` draws them, or of blue noise.
        """
        return make_sampler(self.texel, filter, self.state.spec, self.Params)
