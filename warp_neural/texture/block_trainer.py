"""`BlockTrainer`: latent textures in BC1 blocks and a network."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.texture.block_latents import PARAMETERS, STEPS, BlockData, blocks_side, latents_side
from warp_neural.kernels.texture.block_steps import (
    block_update_kernel,
    gradient_kernel,
    make_block_adjoint_kernel,
    make_block_features_kernel,
    unblock_kernel,
)
from warp_neural.kernels.texture.levels import TILE, TextureData
from warp_neural.kernels.texture.spec import BLOCK_CHANNELS, BlockSpec
from warp_neural.kernels.training.progress import Progress
from warp_neural.texture.batch import Batch
from warp_neural.texture.block_state import BlockLevels, BlockState, to_bc1
from warp_neural.texture.latent_trainer import LatentTrainer
from warp_neural.texture.rounding import network_tensors
from warp_neural.texture.state import Map

APART = 0.2  # deviation of ends at the start, around the middle of their range


class BlockLaunches:
    """Of one latent texture."""

    def __init__(self, spec: BlockSpec, g: int, tiles: int, encoded: wp.array, random: np.random.Generator):
        self.g, self.tiles, self.encoded, device = g, tiles, encoded, encoded.device
        self.levels, self.data = BlockLevels(spec, g), BlockData()
        self.latents, self.blocks = latents_side(spec.scales[g]), blocks_side(spec.scales[g])
        self.data.levels = wp.array(self.levels.table, dtype=wp.vec4i, device=device)
        start = _start(self.levels.blocks, random)
        sizes = {"values": 3 * self.levels.latents, "parameters": start.size}
        sizes |= {"values_gradient": sizes["values"]} | dict.fromkeys(("gradient", "first", "second"), start.size)
        for name, size in sizes.items():
            setattr(self.data, name, wp.zeros(size, dtype=float, device=device))
        self.data.parameters.assign(start)
        self.features_kernel = make_block_features_kernel(encoded.dtype)
        self.adjoint_kernel = make_block_adjoint_kernel(encoded.dtype)

    @property
    def kernels(self) -> list[wp.Kernel]:
        return [unblock_kernel, self.features_kernel, self.adjoint_kernel, gradient_kernel, block_update_kernel]

    def encode(self, progress: Progress, data: TextureData) -> None:
        arguments = [progress, data, self.data, self.tiles, self.g]
        self.launch(unblock_kernel, (self.latents, self.latents), arguments)
        self.launch(self.features_kernel, (TILE, TILE), [*arguments, self.encoded])

    def adjoint(self, progress: Progress, data: TextureData) -> None:
        arguments = [progress, data, self.data, self.tiles, self.g]
        self.launch(self.adjoint_kernel, (TILE, TILE), [*arguments, self.encoded])
        self.launch(gradient_kernel, (self.latents, self.latents), arguments)

    def update(self, progress: Progress, data: TextureData, share: float) -> None:
        arguments = [progress, data, self.data, self.tiles, share]
        self.launch(block_update_kernel, (self.blocks, self.blocks, PARAMETERS), arguments)

    def launch(self, kernel: wp.Kernel, dim: tuple[int, ...], arguments: list) -> None:
        wp.launch(kernel, (self.tiles, *dim), arguments, device=self.encoded.device, record_tape=False)


def _start(blocks: int, random: np.random.Generator) -> np.ndarray:
    """float32 [blocks, 22]: ends apart, indices anywhere."""
    ends = np.clip(0.5 + APART * random.standard_normal((blocks, 2, BLOCK_CHANNELS)), 0, 1) * np.array(STEPS)
    indices = 3 * random.random((blocks, 16))
    return np.concatenate([ends.reshape(blocks, -1), indices], 1).astype(np.float32)


class BlockTrainer(LatentTrainer):
    """Options as of `LatentTrainer`; the steps of latent_rate are those of the blocks' integers."""

    spec: BlockSpec

    def _make_latents(self, random: np.random.Generator) -> Batch:
        def make(g: int, encoded: wp.array) -> BlockLaunches:
            return BlockLaunches(self.spec, g, self.tiles, encoded, random)

        return Batch(self.spec, self.tiles, self.device, make, len(self.spec.scales))

    def _latent_arrays(self) -> dict[str, wp.array]:
        names = "parameters", "first", "second"
        return {f"{name}_{g}": getattr(each.data, name) for g, each in enumerate(self.batch.grids) for name in names}

    def state(self, maps: tuple[Map, ...], extra: Mapping[str, Any] | None = None) -> BlockState:
        """What files hold. Before latents rest, rounded as it would be then."""
        if self.index <= self.schedule.latents_until:
            self._set_steps()
        parameters = [each.data.parameters.numpy().reshape(-1, PARAMETERS) for each in self.batch.grids]
        pairs = zip(self.batch.grids, parameters, strict=True)
        blocks = tuple(tuple(map(to_bc1, each.levels.split(rows))) for each, rows in pairs)
        tensors = network_tensors(self.net, self.network_steps.numpy())
        return BlockState(self.spec, blocks, tensors, maps, extra or {})
