"""A neural texture decoded when it is loaded: all its levels on a device, as codes or in block formats."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
import warp as wp

from warp_neural.imaging.block_encoders import Quality
from warp_neural.imaging.block_texture import BlockTexture
from warp_neural.kernels.errors import require
from warp_neural.kernels.texture import filters
from warp_neural.kernels.texture.block_maps import BlockMap, BlockParams, make_block_texel
from warp_neural.kernels.texture.codes import Codes, CodesParams, make_codes_texel, make_fill_kernel
from warp_neural.kernels.texture.filtering import make_sample, make_sampler
from warp_neural.kernels.texture.texel import make_stored
from warp_neural.texture.decoder import BLOCK
from warp_neural.texture.levels import make_levels
from warp_neural.texture.memory import bytes_of
from warp_neural.texture.save import File, encode_maps, save_blocks
from warp_neural.texture.state import Map
from warp_neural.texture.texture import Texture


class _Maps:
    """In kernels that take `params: maps.Params`, launched with `maps.params`, any thread calls `maps.texel`,
    `maps.sample` or what `maps.make_sampler` makes, in place of the texture's own, with the same results but for
    rounding."""

    @property
    def bytes(self) -> int:
        """Of all levels on the device, with tables."""
        return bytes_of(self.params)

    @cached_property
    def sample(self) -> wp.Function:
        return make_sample(self.texel, self.texture.state.spec, self.Params)

    def make_sampler(self, filter: wp.Function = filters.bilinear) -> wp.Function:
        return make_sampler(self.texel, filter, self.texture.state.spec, self.Params)


class CodedMaps(_Maps):
    """In 8 or 16 bits a channel."""

    Params = CodesParams

    def __init__(self, texture: Texture, bits: int = 8):
        require(bits in (8, 16), "bits", bits, "8 or 16")
        self.texture, spec = texture, texture.state.spec
        self.codes = Codes(spec.channels, bits)
        params = self.params = CodesParams()
        params.levels = make_levels(spec, texture.device)
        texels = sum(int(np.prod(spec.size(mip))) for mip in range(spec.mips))
        params.words = wp.empty((texels, self.codes.words), dtype=wp.uint32, device=texture.device)
        kernel = make_fill_kernel(self.codes, texture.decoder.texel, texture.Params)
        for mip in range(spec.mips):
            inputs = [texture.params, mip, params]
            wp.launch(kernel, spec.size(mip), inputs, device=texture.device, block_dim=BLOCK, record_tape=False)

    @cached_property
    def texel(self) -> wp.Function:
        return make_stored(make_codes_texel(self.codes), self.texture.ranges, self.Params)


class BlockMaps(_Maps):
    """Each map in the block format that `dds_format` chooses. The third number of a normal is what makes it a unit
    vector.

    encoded: the maps by name, for files or for graphics interfaces.
    """

    Params = BlockParams

    def __init__(self, texture: Texture, bc1: bool = False, quality: Quality = "fast"):
        self.texture, state = texture, texture.state
        decoded = [texture.decode(mip) for mip in range(state.spec.mips)]
        self.encoded = encode_maps(decoded, state.maps, bc1, quality)
        self.params = _put(list(self.encoded.values()), texture)

    def save(self, folder: Path | str, file: File = "dds") -> list[Path]:
        """Write NAME.dds or NAME.ktx2 of each map; returns the paths."""
        return save_blocks(folder, self.encoded, file)

    @cached_property
    def texel(self) -> wp.Function:
        pairs = zip(self.texture.state.maps, self.encoded.values(), strict=True)
        return make_block_texel(tuple(BlockMap(encoded.format, _components(each)) for each, encoded in pairs))


def _components(each: Map) -> tuple[int, ...]:
    """Of red, green, blue and alpha those that hold the channels that vary; grey with alpha is red and alpha."""
    return tuple(3 if each.channels == 2 and c == 1 else c for c in each.trained)


def _put(textures: Sequence[BlockTexture], texture: Texture) -> BlockParams:
    """Into one array, each level in whole words."""
    levels = [[np.frombuffer(level + bytes(-len(level) % 4), "<u4") for level in each.levels] for each in textures]
    sizes = np.array([[words.size for words in each] for each in levels])
    params = BlockParams()
    params.levels = make_levels(texture.state.spec, texture.device)
    flat = np.concatenate([words for each in levels for words in each])
    params.words = wp.array(flat, dtype=wp.uint32, device=texture.device)
    first = np.cumsum([0, *sizes.ravel()[:-1]]).reshape(sizes.shape)
    params.first = wp.array(first, dtype=int, device=texture.device)
    return params
