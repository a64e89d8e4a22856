"""`BlockDecoder`: a texture with latents in BC1 blocks on a device."""

from collections.abc import Callable
from functools import cached_property

import numpy as np
import warp as wp

from warp_neural.kernels.texture.block_texel import make_block_params_type, make_block_texel
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.decoder import Decoder
from warp_neural.texture.levels import make_levels


class BlockDecoder(Decoder):
    """As `Decoder`, of a `BlockState`; whole pictures by a thread each texel, in float32."""

    def _put(self, state: BlockState) -> None:
        self.Params = make_block_params_type(self.net.Params)
        params = self.params = self.Params()
        params.network, params.levels = self.net.params, make_levels(state.spec, self.device)
        words = [state.blocks[g][mip].ravel() for mip in range(self.spec.mips) for g in range(len(self.spec.scales))]
        first = np.cumsum([0, *map(len, words[:-1])]).reshape(self.spec.mips, -1)
        params.words = wp.array(np.concatenate(words), dtype=wp.uint32, device=self.device)
        params.first = wp.array(first, dtype=int, device=self.device)

    @cached_property
    def texel(self) -> wp.Function:
        return make_block_texel(self.spec, self.net.func, self.Params)

    def _for_pictures(self) -> tuple[Callable, tuple[type, ...]]:
        return self.decode_alone, (wp.float32,)
