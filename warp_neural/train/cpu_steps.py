"""What a `Trainer` launches for one step on the CPU, as in `warp_neural.train.steps`."""

from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.training.cpu.forward import CHUNK, areas
from warp_neural.kernels.training.cpu.step import make_cpu_gradient_kernel
from warp_neural.kernels.training.progress import Progress
from warp_neural.kernels.training.update import Update
from warp_neural.nn.mlp import MLP
from warp_neural.train.steps import Steps


class FusedCpu(Steps):
    """One kernel for samples, forward, loss and gradients of a whole batch, in the order of the samples."""

    def __init__(
        self, net: MLP, optimizer, progress: Progress, options: Update, sample, data: Any, loss: Loss, sizes: np.ndarray
    ):
        super().__init__(net, optimizer, progress, options, data)
        adjoint = net.encoding and net.encoding.make_adjoint(net.n_in, net.encoding_start)
        self.kernel = make_cpu_gradient_kernel(
            net.spec, sample, loss, net.plain_encode if net.encoding else None, adjoint
        )
        wp.load_module(self.kernel.module, net.device)
        self.scratch = wp.zeros(areas(net.spec)[1], dtype=float, device=net.device)
        self.x = wp.zeros(CHUNK, dtype=net.vec_in, device=net.device)
        self.target = wp.zeros(CHUNK, dtype=wp.types.vector(net.n_out, float), device=net.device)

    def gradient(self, micro: int) -> None:
        net, chunk = self.net, [self.scratch, self.x, self.target]
        inputs = [net.plain, self.data, self.progress, micro, self.options.batches, *chunk, net.gradient]
        wp.launch(self.kernel, 1, inputs, device=net.device, record_tape=False)
