"""What a `Trainer` launches for one step: `gradient(micro)` for each batch of the step, then `update()`.

Both are launches on arrays made beforehand, so that a CUDA graph can hold them.
"""

from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.nn.spec import INT8, Parameters
from warp_neural.kernels.training.encoded_batch import TILE
from warp_neural.kernels.training.fused import make_kernels
from warp_neural.kernels.training.progress import Progress
from warp_neural.kernels.training.rooms import choose_schedule
from warp_neural.kernels.training.schedule import Schedule
from warp_neural.kernels.training.taped import collect_kernel, make_loss_kernel, make_sample_kernel
from warp_neural.kernels.training.taped_update import GROUP, check_kernel, make_update_kernel
from warp_neural.kernels.training.update import COLUMNS, Update, make_fused_update_kernel, update_block
from warp_neural.nn.calibration import Calibration
from warp_neural.nn.loading import load_for
from warp_neural.nn.mlp import MLP
from warp_neural.train.encoded_batch import EncodedBatch, launch
from warp_neural.train.layout import fragment_order, packed_targets

CALIBRATION = 256  # samples of a step that set the steps of INT8
KEEP = 0.99  # of larger steps from the training steps before


def scalars(x: wp.array) -> wp.array:
    """An array of vectors as [n, length]."""
    return wp.array(ptr=x.ptr, dtype=x.dtype._wp_scalar_type_, shape=(x.size, x.dtype._length_), device=x.device)


class Steps:
    """The common part: gradients add up in `net.gradient`, from where all parameters are updated."""

    def __init__(self, net: MLP, optimizer: Any, progress: Progress, options: Update, data: Any):
        self.net, self.optimizer, self.progress, self.options, self.data = net, optimizer, progress, options, data

    def update(self) -> None:
        self.update_from(0, last=True)
        self.pack()

    def pack(self) -> None:
        self.net.pack()

    def update_from(self, first: int, last: bool) -> None:
        """Update the parameters from `first` on from `net.gradient`, which is cleared."""
        net = self.net
        threads = self.threads(net.master.size - first)
        sparse = net.encoding_start if net.encoding and net.encoding.sparse else net.master.size
        which = [first, sparse, last, threads]
        wp.launch(
            make_update_kernel(self.optimizer.update),
            dim=threads,
            inputs=[self.progress, self.options, *which, net.gradient, net.master],
            device=net.device,
            record_tape=False,
        )

    def threads(self, parameters: int) -> int:
        """That move so many parameters, a group each at a time."""
        return -(-parameters // GROUP) if self.net.device.is_cuda else 1

    def gathered(self) -> np.ndarray:
        """The sum of the gradients, scaled, in the order of `net.master`."""
        return self.net.gradient.numpy().copy()


class Taped(Steps):
    """For every network and device: samples to memory, the loss of each through `net.func`, and its adjoint."""

    def __init__(
        self, net: MLP, optimizer, progress: Progress, options: Update, sample, data: Any, loss: Loss, sizes: np.ndarray
    ):
        super().__init__(net, optimizer, progress, options, data)
        spec, device, batch = net.spec, net.device, int(sizes.max())
        self.samples = make_sample_kernel(sample, net.vec_in, spec.sizes[-1])
        self.loss = make_loss_kernel(net.plain_func, spec, net.vec_in, loss)
        size = -(-batch // TILE) * TILE
        self.x = wp.zeros(size, dtype=net.vec_in, device=device)
        self.target = wp.zeros(size, dtype=wp.types.vector(spec.sizes[-1], float), device=device)
        self.losses = wp.zeros(size, dtype=float, device=device, requires_grad=True)
        self.seed = wp.full(size, progress.scale.numpy()[0], dtype=float, device=device)
        wp.load_module(self.samples.module, device, block_dim=TILE)
        self.launch = {"dim": size, "device": device, "block_dim": TILE, "record_tape": False}
        if spec.format is INT8:
            n = min(CALIBRATION, int(sizes.min()))
            self.calibration, self.inputs = Calibration(net, n), scalars(self.x)[:n]
            self.draw(0)
            self.calibration.run(self.inputs)

    def draw(self, micro: int) -> None:
        wp.launch(self.samples, inputs=[self.data, self.progress, micro, self.x, self.target], **self.launch)

    def update(self) -> None:
        gradient = self.net.gradient
        inputs = [self.progress, gradient, threads := self.threads(gradient.size)]
        wp.launch(check_kernel, threads, inputs, device=self.net.device, record_tape=False)
        super().update()

    def pack(self) -> None:
        if self.net.spec.format is INT8:  # the samples of the last batch, the parameters of the next step
            self.calibration.run(self.inputs, KEEP)
        else:
            super().pack()

    def gradient(self, micro: int) -> None:
        launch = self.launch
        self.draw(micro)
        inputs = [self.net.plain, self.progress, self.x, self.target, self.losses]
        wp.launch(self.loss, inputs=inputs, **launch)
        wp.launch(collect_kernel, inputs=[self.progress, self.options.batches, self.losses], **launch)
        wp.copy(self.losses.grad, self.seed)
        wp.launch(
            self.loss, inputs=inputs, adj_inputs=[Parameters(), Progress(), None, None, None], adjoint=True, **launch
        )


def schedule_of(net: MLP) -> Schedule | None:
    """How blocks of the network's CUDA device train it in one kernel; None if they cannot."""
    return choose_schedule(net.spec, net.device.arch, net.device.max_shared_memory_per_block)


class FusedCuda(Steps):
    """One kernel for samples, forward, loss and the gradients of each block, or one for each of two passes; one for
    their sum and the new parameters. A trainable encoding has kernels of its own before and after.

    encoded_batch: what makes the network's inputs, instead of its encoding.
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
        device, batch = net.device, int(sizes.max())
        self.schedule = schedule = schedule_of(net)
        self.encoded_batch = encoded_batch or EncodedBatch(net, sample, batch)
        encode = net.plain_encode if net.encoding and not self.encoded_batch.used else None
        used, fast_math = self.encoded_batch.used, encoded_batch is not None
        self.kernels = make_kernels(net.spec, schedule, sample, loss, encode, used, fast_math)
        for kernel in self.kernels:
            load_for(kernel, schedule, device)
        self.update_kernel = make_fused_update_kernel(optimizer.update, net.spec, schedule)
        blocks = min(device.sm_count, -(-batch // schedule.round_samples))  # one on each multiprocessor
        self.kept = wp.empty(schedule.kept_units(blocks, batch), dtype=wp.vec4ui, device=device)
        self.partial = wp.zeros((blocks, schedule.block_sums), dtype=float, device=device)
        self.order = wp.array(fragment_order(schedule), dtype=int, device=device)
        self.target = wp.array(packed_targets(net.spec), dtype=int, device=device)

    def gradient(self, micro: int) -> None:
        inputs, threads = [self.net.plain, self.data, self.progress, micro], self.schedule.threads
        self.encoded_batch.encode(inputs)
        for kernel in self.kernels:
            arrays = [self.partial, self.encoded_batch.values, self.kept]
            launch(kernel, self.partial.shape[0] * threads, [*inputs, *arrays], threads, self.net.device)
        self.encoded_batch.adjoint(inputs)

    def update(self) -> None:
        net, aside = self.net, self.encoded_batch.aside
        if aside:
            with wp.ScopedStream(aside):
                self.update_from(net.encoding_start, last=False)
        arrays = [self.partial, self.order, self.target, net.master, net.packed]
        block = update_block(self.schedule)
        dim = -(-(self.schedule.floats + 1) // COLUMNS) * block
        launch(self.update_kernel, dim, [self.progress, self.options, *arrays], block, self.net.device)
        if aside:
            net.device.stream.wait_stream(aside)

    def gathered(self) -> np.ndarray:
        gradient = super().gathered()  # of the encoding
        order, total = self.order.numpy(), self.partial.numpy().sum(0, dtype=np.float64)[: self.schedule.floats]
        gradient[order[order >= 0]] = total[order >= 0]
        return gradient
