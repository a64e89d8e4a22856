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
    """One kernel for samples, forward, loss and gradients of a whole batch, in the order of the samples.

    encoded_batch: what makes the network's inputs, instead of its encoding, as `train.encoded_batch.EncodedBatch`.
    """

    def __init__(
        self,
        net: MLP,
        optimizer,
        progress: Progress,
        options: Update,
        sample,
        data: Any,
        loss: Loss,
        sizes: np.ndarray,
        encoded_batch: Any = None,
    ):
        super().__init__(net, optimizer, progress, options, data)
        self.encoded_batch = encoded_batch
        adjoint = net.encoding and net.encoding.make_adjoint(net.n_in, net.encoding_start)
        self.kernel = make_cpu_gradient_kernel(
            net.spec, sample, loss, net.plain_encode if net.encoding else None, adjoint, encoded_batch is not None
        )
        wp.load_module(self.kernel.module, net.device)
        self.scratch = wp.zeros(areas(net.spec)[1], dtype=float, device=net.device)
        self.x = wp.zeros(CHUNK, dtype=net.vec_in, device=net.device)
        self.target = wp.zeros(CHUNK, dtype=wp.types.vector(net.n_out, float), device=net.device)
        self.encoded = encoded_batch.values if encoded_batch else wp.zeros((0, 0), dtype=float, device=net.device)

    def gradient(self, micro: int) -> None:
        net, chunk = self.net, [self.scratch, self.x, self.target]
        inputs = [self.net.plain, self.data, self.progress, micro]
        if self.encoded_batch:
            self.encoded_batch.encode(inputs)
        arguments = [*inputs, self.options.batches, *chunk, net.gradient, self.encoded]
        wp.launch(self.kernel, 1, arguments, device=net.device, record_tape=False)
        if self.encoded_batch:
            self.encoded_batch.adjoint(inputs)
