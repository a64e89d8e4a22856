"""What a `Trainer` launches for one step: `gradient(micro)` for each batch of the step, then `update()`.

Both are launches on arrays made beforehand, so that a CUDA graph can hold them.
"""

from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.nn.encodings.base import Leaf
from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.nn.spec import Parameters
from warp_neural.kernels.training.encoded_batch import (
    SHARED_SUMS_TILE,
    TILE,
    encoded_type,
    make_adjoint_sample,
    make_encode_sample,
    make_encoded_kernel,
    make_shared_sums_kernel,
    threads_of,
)
from warp_neural.kernels.training.fused import FusedSchedule, make_gradient_kernel, samples_of
from warp_neural.kernels.training.hopper64 import schedule as hopper64
from warp_neural.kernels.training.hopper128 import schedule as hopper128
from warp_neural.kernels.training.hopper128.lower_step import kept_units, make_lower_kernel
from warp_neural.kernels.training.mma.schedule import MmaSchedule, make_schedule
from warp_neural.kernels.training.progress import Progress
from warp_neural.kernels.training.taped import collect_kernel, make_loss_kernel, make_sample_kernel
from warp_neural.kernels.training.taped_update import GROUP, make_update_kernel
from warp_neural.kernels.training.update import COLUMNS, Update, make_fused_update_kernel, update_block
from warp_neural.nn.mlp import MLP
from warp_neural.train.layout import fragment_order, packed_targets


class Steps:
    """The common part: gradients add up in `net.gradient`, from where all parameters are updated."""

    def __init__(self, net: MLP, optimizer: Any, progress: Progress, options: Update, data: Any):
        self.net, self.optimizer, self.progress, self.options, self.data = net, optimizer, progress, options, data

    def update(self) -> None:
        self.update_from(0, last=True)
        self.net.pack()

    def update_from(self, first: int, last: bool) -> None:
        """Update the parameters from `first` on from `net.gradient`, which is cleared."""
        net = self.net
        threads = -(-(net.master.size - first) // GROUP) if net.device.is_cuda else 1
        sparse = net.encoding_start if net.encoding and net.encoding.sparse else net.master.size
        which = [first, sparse, last, threads]
        wp.launch(
            make_update_kernel(self.optimizer.update),
            dim=threads,
            inputs=[self.progress, self.options, *which, net.gradient, net.master],
            device=net.device,
            record_tape=False,
        )

    def gathered(self) -> np.ndarray:
        """The sum of the gradients, scaled, in the order of `net.master`."""
        return self.net.gradient.numpy().copy()


class Taped(Steps):
    """For every network and device: samples to memory, the loss of each through `net.func`, and its adjoint."""

    def __init__(
        self, net: MLP, optimizer, progress: Progress, options: Update, sample, data: Any, loss: Loss, batch: int
    ):
        super().__init__(net, optimizer, progress, options, data)
        spec, device = net.spec, net.device
        self.samples = make_sample_kernel(sample, net.vec_in, spec.sizes[-1])
        self.loss = make_loss_kernel(net.func, spec, net.vec_in, loss)
        size = -(-batch // TILE) * TILE
        self.x = wp.zeros(size, dtype=net.vec_in, device=device)
        self.target = wp.zeros(size, dtype=wp.types.vector(spec.sizes[-1], float), device=device)
        self.losses = wp.zeros(size, dtype=float, device=device, requires_grad=True)
        self.seed = wp.full(size, progress.scale.numpy()[0], dtype=float, device=device)

    def gradient(self, micro: int) -> None:
        launch = {"dim": self.losses.size, "device": self.net.device, "block_dim": TILE, "record_tape": False}
        wp.launch(self.samples, inputs=[self.data, self.progress, micro, self.x, self.target], **launch)
        inputs = [self.net.params, self.progress, self.x, self.target, self.losses]
        wp.launch(self.loss, inputs=inputs, **launch)
        wp.launch(collect_kernel, inputs=[self.progress, self.options.batches, self.losses], **launch)
        wp.copy(self.losses.grad, self.seed)
        wp.launch(
            self.loss, inputs=inputs, adj_inputs=[Parameters(), Progress(), None, None, None], adjoint=True, **launch
        )


def schedule_of(net: MLP) -> FusedSchedule | None:
    """How blocks of the network's CUDA device train it in one kernel; None if they cannot."""
    spec, device = net.spec, net.device
    if device.arch < spec.format.min_arch:
        return None
    hopper = hopper64.make_schedule(spec) or hopper128.make_schedule(spec) if device.arch == 90 else None
    return hopper or make_schedule(spec, device.max_shared_memory_per_block)


def load_for(kernel: wp.Kernel, schedule: FusedSchedule, device: wp.Device) -> None:
    """Compile and load the fused kernel. `wgmma` only exists in code for exactly one architecture, sm_90a."""
    before = wp.config.cuda_arch_suffix
    wp.config.cuda_arch_suffix = before if isinstance(schedule, MmaSchedule) else "a"
    try:
        wp.load_module(kernel.module, device, block_dim=schedule.threads)
    finally:
        wp.config.cuda_arch_suffix = before


def launch(kernel: wp.Kernel, dim: int, inputs: list, block_dim: int, device: wp.Device) -> None:
    wp.launch(kernel, dim, inputs, device=device, block_dim=block_dim, record_tape=False)


class LeafSteps:
    """The launches between the inputs and the results of one leaf of an encoding, which lie in `encoded`. aside:
    another stream for what can run beside the rest."""

    def __init__(self, leaf: Leaf, net: MLP, sample: wp.Function, encoded: wp.array, aside: wp.Stream):
        n_in, parts, item = len(leaf.inputs), leaf.encoding.n_parts, encoded.strides[1]
        n, format, self.device = leaf.encoding.n_out(n_in) // parts, net.spec.format, encoded.device
        which = leaf, net.vec_in, net.encoding_start + leaf.parameter, format
        shape, strides = (encoded.shape[0], parts, n), (encoded.strides[0], n * item, item)
        first = encoded.ptr + leaf.result * item
        self.encoded = wp.array(ptr=first, shape=shape, strides=strides, dtype=encoded.dtype, device=encoded.device)
        self.threads, self.aside = threads_of(leaf, encoded.shape[0]), aside
        self.trains, self.shared_sums = leaf.encoding.n_parameters(n_in) > 0, leaf.encoding.shared_sums(n_in) > 0
        self.encode_kernel = make_encoded_kernel(sample, make_encode_sample(*which), leaf, format)
        if self.trains:
            self.adjoint_kernel = make_encoded_kernel(sample, make_adjoint_sample(*which), leaf, format)
        if self.shared_sums:
            self.shared_sums_kernel = make_shared_sums_kernel(sample, *which)

    def encode(self, inputs: list) -> None:
        launch(self.encode_kernel, self.threads, [*inputs, self.encoded], TILE, self.device)

    def adjoint(self, inputs: list) -> None:
        if self.shared_sums:  # side by side: one is held up by shared memory, the other by L2
            blocks = min(self.device.sm_count, -(-self.encoded.shape[0] // SHARED_SUMS_TILE))
            with wp.ScopedStream(self.aside):
                launch(
                    self.shared_sums_kernel,
                    blocks * SHARED_SUMS_TILE,
                    [*inputs, blocks, self.encoded],
                    SHARED_SUMS_TILE,
                    self.device,
                )
        if self.trains:
            launch(self.adjoint_kernel, self.threads, [*inputs, self.encoded], TILE, self.device)
        if self.shared_sums:
            self.device.stream.wait_stream(self.aside)


class FusedCuda(Steps):
    """One kernel for samples, forward, loss and gradients, one for the update of all parameters.

    Encodings with parameters have kernels before and after it, and an update of their own.
    """

    def __init__(
        self, net: MLP, optimizer, progress: Progress, options: Update, sample, data: Any, loss: Loss, batch: int
    ):
        super().__init__(net, optimizer, progress, options, data)
        device = net.device
        self.schedule = schedule = schedule_of(net)
        self.from_encoded = net.encoding is not None and net.encoding.n_parameters(net.n_in) > 0
        encode = net.encode if net.encoding and not self.from_encoded else None
        self.kernel = make_gradient_kernel(net.spec, schedule, sample, loss, encode, self.from_encoded)
        load_for(self.kernel, schedule, device)
        shape, format = (batch if self.from_encoded else 0, net.spec.sizes[0]), net.spec.format
        self.encoded = wp.zeros(shape, dtype=encoded_type(format), device=device)
        self.leaves = []
        if self.from_encoded:
            self.aside = wp.Stream(device)
            self.leaves = [
                LeafSteps(leaf, net, sample, self.encoded, self.aside) for leaf in net.encoding.leaves(net.n_in)
            ]
        self.update_kernel = make_fused_update_kernel(optimizer.update, net.spec, schedule)
        blocks = min(device.sm_count, -(-batch // samples_of(schedule)))  # one on each multiprocessor
        kept = 0
        if schedule.lower:
            self.lower_kernel = make_lower_kernel(net.spec, schedule.lower, self.from_encoded)
            load_for(self.lower_kernel, schedule, device)
            kept = kept_units(schedule.lower, blocks, batch)
        self.kept = wp.empty(kept, dtype=wp.vec4ui, device=device)
        self.partial = wp.zeros((blocks, schedule.block_sums), dtype=float, device=device)
        self.order = wp.array(fragment_order(schedule), dtype=int, device=device)
        self.target = wp.array(packed_targets(net.spec), dtype=int, device=device)

    def gradient(self, micro: int) -> None:
        inputs = [self.net.params, self.data, self.progress, micro]
        for leaf in self.leaves:
            leaf.encode(inputs)
        threads, arrays = self.schedule.threads, [self.partial, self.encoded, self.kept]
        launch(self.kernel, self.partial.shape[0] * threads, [*inputs, *arrays], threads, self.net.device)
        if self.schedule.lower:
            lower = [self.net.params, self.progress, micro, *arrays]
            launch(self.lower_kernel, self.partial.shape[0] * threads, lower, threads, self.net.device)
        for leaf in self.leaves:
            leaf.adjoint(inputs)

    def update(self) -> None:
        net = self.net
        if self.from_encoded:
            with wp.ScopedStream(self.aside):
                self.update_from(net.encoding_start, last=False)
        arrays = [self.partial, self.order, self.target, net.master, net.packed]
        block = update_block(self.schedule)
        dim = -(-(self.schedule.floats + 1) // COLUMNS) * block
        launch(self.update_kernel, dim, [self.progress, self.options, *arrays], block, self.net.device)
        if self.from_encoded:
            net.device.stream.wait_stream(self.aside)

    def gathered(self) -> np.ndarray:
        gradient = super().gathered()  # of the encoding
        order, total = self.order.numpy(), self.partial.numpy().sum(0, dtype=np.float64)[: self.schedule.floats]
        gradient[order[order >= 0]] = total[order >= 0]
        return gradient
