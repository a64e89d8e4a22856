"""What a training step launches for the grids: before the network's kernel, after it, and to move the latents."""

from collections.abc import Callable
from math import ceil
from typing import Any

import warp as wp

from warp_neural.kernels.texture.features import (
    adjoint_rows,
    kernel_parts,
    make_adjoint_kernel,
    make_disturb_kernel,
    make_features_kernel,
    make_kernel_adjoint_kernel,
    side,
)
from warp_neural.kernels.texture.levels import TILE, TextureData
from warp_neural.kernels.texture.rate import make_rate_kernel
from warp_neural.kernels.texture.spec import BlockSpec, TextureSpec
from warp_neural.kernels.texture.update import make_latents_kernel
from warp_neural.kernels.training.progress import Progress


class GridLaunches:
    """Of one grid. noisy: its latents in the tiles of a step. rated: their bits cost."""

    def __init__(self, spec: TextureSpec, g: int, tiles: int, encoded: wp.array, rated: bool):
        grid, which = spec.grids[g], (spec, g, encoded.dtype)
        self.tiles, self.encoded, self.channels, self.scale = tiles, encoded, grid.channels, grid.scale
        self.cells, self.side = TILE // grid.scale, side(grid.scale)
        self.noisy = wp.zeros(tiles * self.side**2 * grid.channels, dtype=float, device=encoded.device)
        self.disturb_kernel, self.features_kernel = make_disturb_kernel(spec, g), make_features_kernel(*which)
        self.adjoint_kernel, self.update_kernel = make_adjoint_kernel(*which), make_latents_kernel(spec, g)
        self.taps_kernel = make_kernel_adjoint_kernel(*which) if grid.kernel != "bilinear" else None
        self.rate_kernel = make_rate_kernel(spec, g) if rated and grid.bits > 1 else None

    @property
    def kernels(self) -> list[wp.Kernel]:
        return [kernel for kernel in vars(self).values() if isinstance(kernel, wp.Kernel)]

    def encode(self, progress: Progress, data: TextureData) -> None:
        arguments = [progress, data, self.tiles, self.noisy]
        self.launch(self.disturb_kernel, (self.side, self.side, ceil(self.channels / 4)), arguments)
        self.launch(self.features_kernel, (TILE, self.cells, self.channels), [*arguments, self.encoded])

    def adjoint(self, progress: Progress, data: TextureData) -> None:
        dim = TILE // adjoint_rows(self.scale), self.cells, self.channels
        self.launch(self.adjoint_kernel, dim, [progress, data, self.tiles, self.encoded])
        if self.taps_kernel:
            dim = self.tiles * kernel_parts(self.scale), self.scale, self.scale, self.channels
            arguments = [data, self.noisy, self.encoded]
            wp.launch(self.taps_kernel, dim, arguments, device=self.encoded.device, record_tape=False)
        if self.rate_kernel:
            self.launch(self.rate_kernel, (self.cells, self.channels), [progress, data, self.tiles, self.noisy])

    def update(self, progress: Progress, data: TextureData, share: float) -> None:
        self.launch(self.update_kernel, (self.side, self.side, self.channels), [progress, data, self.tiles, share])

    def launch(self, kernel: wp.Kernel, dim: tuple[int, ...], arguments: list) -> None:
        wp.launch(kernel, (self.tiles, *dim), arguments, device=self.encoded.device, record_tape=False)


class Batch:
    """`values` [texels of a step, n_in]: the network's inputs, after its kernel the gradients to them. grids: each
    makes some columns of it and takes the gradients to these; `make(g, values)` of each g below `count`. Stands in for
    `warp_neural.train.encoded_batch.EncodedBatch`."""

    used, aside = True, None

    def __init__(
        self,
        spec: TextureSpec | BlockSpec,
        tiles: int,
        device: wp.Device,
        make: Callable[[int, wp.array], Any],
        count: int,
    ):
        dtype = wp.float16 if device.is_cuda else wp.float32
        self.values = wp.zeros((tiles * TILE * TILE, spec.n_in), dtype=dtype, device=device)
        self.grids = [make(g, self.values) for g in range(count)]
        wp.force_load(device, list({kernel.module for grid in self.grids for kernel in grid.kernels}))  # side by side
        self.streams = [wp.Stream(device) if device.is_cuda else None for _ in self.grids]

    def encode(self, inputs: list) -> None:
        progress, data = inputs[2], inputs[1]
        self.side_by_side(lambda grid: grid.encode(progress, data))

    def adjoint(self, inputs: list) -> None:
        progress, data = inputs[2], inputs[1]
        self.side_by_side(lambda grid: grid.adjoint(progress, data))

    def update(self, progress: Progress, data: TextureData, share: float) -> None:
        self.side_by_side(lambda grid: grid.update(progress, data, share))

    def side_by_side(self, launch: Callable[[Any], None]) -> None:
        """For each grid, on a stream of its own: each alone leaves most of the device idle."""
        for grid, stream in zip(self.grids, self.streams, strict=True):
            with wp.ScopedStream(stream):
                launch(grid)
        for stream in filter(None, self.streams):
            stream.device.stream.wait_stream(stream)
