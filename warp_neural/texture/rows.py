"""`RowDecoder`: whole pictures of a texture on the CPU, on all cores."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any

import warp as wp

from warp_neural.kernels.texture.rows import make_row_table_kernel, make_rows_kernel, row_tables
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.training.cpu.forward import areas
from warp_neural.nn.mlp import MLP

ENOUGH = 4096  # texels that are worth a thread


class RowDecoder:
    """Of a texture's parameters and its network. Launches of one CPU kernel run side by side: Warp's only state there
    is that of tiles in shared memory, which this kernel has none of."""

    def __init__(self, spec: TextureSpec, params_type: Any, params: Any, net: MLP):
        self.spec, self.params_type, self.params = spec, params_type, params
        self.net, self.device = net, net.device
        self.tables = wp.zeros(row_tables(spec)[-1], dtype=float, device=self.device)
        for g, grid in enumerate(spec.grids):
            dim = grid.scale, grid.scale, grid.channels
            wp.launch(make_row_table_kernel(spec, g), dim, [params.kernels, self.tables], device=self.device)

    @cached_property
    def kernel(self) -> wp.Kernel:
        return make_rows_kernel(self.spec, self.net.spec, self.params_type)

    def decode(self, mip: int, rectangle: tuple[int, int, int, int], values: wp.array) -> None:
        """rectangle: left, top, width, height. values: float [height, width, channels], contiguous."""
        left, top, width, height = rectangle
        count = max(min(os.cpu_count() or 1, height, width * height // ENOUGH), 1)
        commands = []
        for n in range(count):
            scratch = wp.zeros(areas(self.net.spec)[1], dtype=float, device=self.device)
            inputs = [self.params, self.net.plain, self.tables, mip, top, left]
            inputs += [n * height // count, (n + 1) * height // count]
            launch = wp.launch(self.kernel, 1, [*inputs, scratch, values], device=self.device, record_cmd=True)
            commands.append((launch, scratch))
        if count == 1:
            commands[0][0].launch()
            return
        with ThreadPoolExecutor(count) as pool:
            for done in [pool.submit(launch.launch) for launch, _ in commands]:
                done.result()
