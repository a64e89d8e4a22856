"""`EngineTexture`: a neural texture whose latents are ordinary textures of BC1 blocks."""

from functools import cached_property
from pathlib import Path
from typing import Any

import warp as wp

from warp_neural.kernels.texture.block_texel import make_block_sample
from warp_neural.texture.block_decoder import BlockDecoder
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.engine_file import save_engine
from warp_neural.texture.save import File
from warp_neural.texture.texture import Texture


class EngineTexture(Texture):
    """As `Texture`, for engines: files are DDS or KTX 2.0 and a network, and hardware filters what it reads.

    `sample` filters latents, as GPUs do, and evaluates the network once; results are those of filtered texels where
    the network is nearly linear. Functions of `make_sampler` draw one texel, as of any texture.
    """

    state: BlockState

    @cached_property
    def decoder(self) -> BlockDecoder:
        return BlockDecoder(self.state, self.device)

    @cached_property
    def sample(self) -> wp.Function:
        """`(params, uv: vec2, lod: float) -> vec`: trilinear reads of the latent textures, one evaluation of the
        network. Gradients, by `wp.Tape`, go to uv and lod."""
        return make_block_sample(self.state.spec, self.decoder.net.func, self.ranges, self.Params)

    def save(self, path: Path | str, file: File = "dds") -> dict[str, Any]:
        """Write NAME.safetensors, the network with what the textures mean, and beside it NAME_latent_0.dds (or .ktx2),
        ...; returns their bytes: network, latents (of each texture), all."""
        return save_engine(path, self.state, file)
