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
    CROWD_TILE,
    TILE,
    make_adjoint_row,
    make_crowd_kernel,
    make_encode_row,
    make_rows_kernel,
    row_type,
    threads_of,
)
from warp_neural.kernels.training.fused import FusedPlan, make_gradient_kernel, samples_of
from warp_neural.kernels.training.hopper64.schedule import make_warpgroup_plan
from warp_neural.kernels.training.hopper128.lower_step import kept_units, make_lower_kernel
from warp_neural.kernels.training.hopper128.schedule import make_wide_plan
from warp_neural.kernels.training.mma.schedule import Plan, make_plan
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


class General(Steps):
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


def plan_of(net: MLP) -> FusedPlan | None:
    """How blocks of the network's CUDA device train it in one kernel; None if they cannot."""
    spec, device = net.spec, net.device
    if device.arch < spec.format.min_arch:
        return None
    hopper = make_warpgroup_plan(spec) or make_wide_plan(spec) if device.arch == 90 else None
    return hopper or make_plan(spec, device.max_shared_memory_per_block)


def load_for(kernel: wp.Kernel, plan: FusedPlan, device: wp.Device) -> None:
    """Compile and load the fused kernel. `wgmma` only exists in code for exactly one architecture, sm_90a."""
    before = wp.config.cuda_arch_suffix
    wp.config.cuda_arch_suffix = before if isinstance(plan, Plan) else "a"
    try:
        wp.load_module(kernel.module, device, block_dim=plan.threads)
    finally:
        wp.config.cuda_arch_suffix = before


def launch(kernel: wp.Kernel, dim: int, inputs: list, block_dim: int, device: wp.Device) -> None:
    wp.launch(kernel, dim, inputs, device=device, block_dim=block_dim, record_tape=False)


class LeafSteps:
    """The launches between the inputs and the results of one leaf of an encoding, which lie in `rows`. aside: another
    stream for what can run beside the rest."""

    def __init__(self, leaf: Leaf, net: MLP, sample: wp.Function, rows: wp.array, aside: wp.Stream):
        n_in, shares, item = len(leaf.inputs), leaf.encoding.shares, rows.strides[1]
        n, format, self.device = leaf.encoding.n_out(n_in) // shares, net.spec.format, rows.device
        which = leaf, net.vec_in, net.encoding_start + leaf.parameter, format
        shape, strides = (rows.shape[0], shares, n), (rows.strides[0], n * item, item)
        first = rows.ptr + leaf.result * item
        self.rows = wp.array(ptr=first, shape=shape, strides=strides, dtype=rows.dtype, device=rows.device)
        self.threads, self.aside = threads_of(leaf, rows.shape[0]), aside
        self.trains, self.crowded = leaf.encoding.n_parameters(n_in) > 0, leaf.encoding.crowded(n_in) > 0
        self.encode_kernel = make_rows_kernel(sample, make_encode_row(*which), leaf, format)
        if self.trains:
            self.adjoint_kernel = make_rows_kernel(sample, make_adjoint_row(*which), leaf, format)
        if self.crowded:
            self.crowd_kernel = make_crowd_kernel(sample, *which)

    def encode(self, inputs: list) -> None:
        launch(self.encode_kernel, self.threads, [*inputs, self.rows], TILE, self.device)

    def adjoint(self, inputs: list) -> None:
        if self.crowded:  # side by side: one is held up by shared memory, the other by L2
            blocks = min(self.device.sm_count, -(-self.rows.shape[0] // CROWD_TILE))
            with wp.ScopedStream(self.aside):
                launch(self.crowd_kernel, blocks * CROWD_TILE, [*inputs, blocks, self.rows], CROWD_TILE, self.device)
        if self.trains:
            launch(self.adjoint_kernel, self.threads, [*inputs, self.rows], TILE, self.device)
        if self.crowded:
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
        self.plan = plan = plan_of(net)
        self.by_rows = net.encoding is not None and net.encoding.n_parameters(net.n_in) > 0
        encode = net.encode if net.encoding and not self.by_rows else None
        self.kernel = make_gradient_kernel(net.spec, plan, sample, loss, encode, self.by_rows)
        load_for(self.kernel, plan, device)
        shape, format = (batch if self.by_rows else 0, net.spec.sizes[0]), net.spec.format
        self.rows = wp.zeros(shape, dtype=row_type(format), device=device)
        self.leaves = []
        if self.by_rows:
            self.aside = wp.Stream(device)
            self.leaves = [
                LeafSteps(leaf, net, sample, self.rows, self.aside) for leaf in net.encoding.leaves(net.n_in)
            ]
        self.update_kernel = make_fused_update_kernel(optimizer.update, net.spec, plan)
        blocks = min(device.sm_count, -(-batch // samples_of(plan)))  # one on each multiprocessor
        kept = 0
        if plan.lower:
            self.lower_kernel = make_lower_kernel(net.spec, plan.lower, self.by_rows)
            load_for(self.lower_kernel, plan, device)
            kept = kept_units(plan.lower, blocks, batch)
        self.kept = wp.empty(kept, dtype=wp.vec4ui, device=device)
        self.partial = wp.zeros((blocks, plan.slice), dtype=float, device=device)
        self.order = wp.array(fragment_order(plan), dtype=int, device=device)
        self.target = wp.array(packed_targets(net.spec), dtype=int, device=device)

    def gradient(self, micro: int) -> None:
        inputs = [self.net.params, self.data, self.progress, micro]
        for leaf in self.leaves:
            leaf.encode(inputs)
        threads, arrays = self.plan.threads, [self.partial, self.rows, self.kept]
        launch(self.kernel, self.partial.shape[0] * threads, [*inputs, *arrays], threads, self.net.device)
        if self.plan.lower:
            lower = [self.net.params, self.progress, micro, *arrays]
            launch(self.lower_kernel, self.partial.shape[0] * threads, lower, threads, self.net.device)
        for leaf in self.leaves:
            leaf.adjoint(inputs)

    def update(self) -> None:
        net = self.net
        if self.by_rows:
            with wp.ScopedStream(self.aside):
                self.update_from(net.encoding_start, last=False)
        arrays = [self.partial, self.order, self.target, net.master, net.packed]
        block = update_block(self.plan)
        dim = -(-(self.plan.floats + 1) // COLUMNS) * block
        launch(self.update_kernel, dim, [self.progress, self.options, *arrays], block, self.net.device)
        if self.by_rows:
            net.device.stream.wait_stream(self.aside)

    def gathered(self) -> np.ndarray:
        gradient = super().gathered()  # of the encoding
        order, total = self.order.numpy(), self.partial.numpy().sum(0, dtype=np.float64)[: self.plan.floats]
        gradient[order[order >= 0]] = total[order >= 0]
        return gradient
