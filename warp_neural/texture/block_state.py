"""A neural texture with latents in BC1 blocks, as data: between training, files and devices."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import BLOCK_CHANNELS, BlockSpec
from warp_neural.texture.state import Map, Tensor, check_parts

_INDICES = np.array([0, 2, 3, 1], np.uint32)  # BC1's, from the first end to the second
_OTHER_WAY = np.array([3, 2, 1, 0])


class BlockLevels:
    """Where the levels of a latent texture begin. table: int32 [mips, 4], as `BlockData.levels`."""

    def __init__(self, spec: BlockSpec, g: int):
        sides = np.array([spec.latents(m, g) for m in range(spec.mips)])
        blocks = np.array([spec.blocks(m, g) for m in range(spec.mips)]).prod(1)
        latents = np.cumsum([0, *sides.prod(1)])
        self.starts = np.cumsum([0, *blocks])
        self.latents, self.blocks = int(latents[-1]), int(self.starts[-1])
        self.table = np.column_stack([sides, latents[:-1], self.starts[:-1]]).astype(np.int32)

    def split(self, rows: np.ndarray) -> list[np.ndarray]:
        """[blocks of all levels, ...] to those of each."""
        return np.split(rows, self.starts[1:-1])


@dataclass(frozen=True)
class BlockState:
    """blocks: of each latent texture and mip BC1 blocks by rows, uint32 [blocks, 2], as they lie in a DDS file.
    tensors, maps, extra: as of `TextureState`."""

    spec: BlockSpec
    blocks: tuple[tuple[np.ndarray, ...], ...]
    tensors: Mapping[str, Tensor]
    maps: tuple[Map, ...]
    extra: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        spec = self.spec
        for g in range(len(spec.scales)):
            for mip in range(spec.mips):
                rows, columns = spec.blocks(mip, g)
                if self.blocks[g][mip].shape != (rows * columns, 2) or self.blocks[g][mip].dtype != np.uint32:
                    raise InputError(
                        f"latent texture {g}, mip {mip}: expected uint32 [{rows * columns}, 2], its blocks"
                    )
        check_parts(spec, self.tensors, self.maps)


def to_bc1(parameters: np.ndarray) -> np.ndarray:
    """Parameters [blocks, 22] as `kernels.texture.block_latents` has them to words, uint32 [blocks, 2].

    The first end is the larger number, or the block would be one of three colours and black.
    """
    ends = np.rint(parameters[:, : 2 * BLOCK_CHANNELS]).astype(np.uint32).reshape(-1, 2, BLOCK_CHANNELS)
    codes = ends[..., 0] << 11 | ends[..., 1] << 5 | ends[..., 2]  # [blocks, 2]
    indices = np.rint(parameters[:, 2 * BLOCK_CHANNELS :]).astype(np.intp)
    indices = np.where((codes[:, 0] < codes[:, 1])[:, None], _OTHER_WAY[indices], indices)
    indices = np.where((codes[:, 0] == codes[:, 1])[:, None], 0, indices)
    bits = np.bitwise_or.reduce(_INDICES[indices] << np.arange(0, 32, 2, dtype=np.uint32), axis=1)
    return np.stack([codes.max(1) | codes.min(1) << np.uint32(16), bits], 1)
