"""The launches of a trainable encoding beside the fused kernel: see `kernels.training.encoded_batch`."""

import warp as wp

from warp_neural.kernels.errors import require_whole
from warp_neural.kernels.nn.encodings.base import Leaf
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
from warp_neural.nn.mlp import MLP


class EncodedBatch:
    """`values` [batch, n_out of the encoding]: the encoded samples, after the fused kernel the gradients to them.

    Empty, not `used`, where the encoding has no parameters. aside: a stream for what can run beside the rest.
    """

    def __init__(self, net: MLP, sample: wp.Function, batch: int):
        self.used = net.encoding is not None and net.encoding.n_parameters(net.n_in) > 0
        for leaf in net.encoding.leaves(net.n_in) if self.used else ():
            require_whole(f"batch={batch}: threads of {type(leaf.encoding).__name__}", threads_of(leaf, batch))
        shape = batch if self.used else 0, net.spec.sizes[0]
        self.values = wp.zeros(shape, dtype=encoded_type(net.spec.format), device=net.device)
        self.leaves, self.aside = [], None
        if self.used:
            self.aside = wp.Stream(net.device)
            leaves = net.encoding.leaves(net.n_in)
            self.leaves = [LeafSteps(leaf, net, sample, self.values, self.aside) for leaf in leaves]

    def encode(self, inputs: list) -> None:
        """inputs: of kernels of samples, their data and where the run is."""
        for leaf in self.leaves:
            leaf.encode(inputs)

    def adjoint(self, inputs: list) -> None:
        for leaf in self.leaves:
            leaf.adjoint(inputs)


class LeafSteps:
    """The launches between the inputs and the results of one leaf of an encoding, which lie in `encoded`.
    aside: another stream for what can run beside the rest."""

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


def launch(kernel: wp.Kernel, dim: int, inputs: list, block_dim: int, device: wp.Device) -> None:
    wp.launch(kernel, dim, inputs, device=device, block_dim=block_dim, record_tape=False)
