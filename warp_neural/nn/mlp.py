"""`MLP`: a small fully connected network that any thread of any Warp kernel can call, and the arrays it reads."""

from collections.abc import Callable
from functools import cached_property

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.coopvec.layout import bias_is_half, layer_table, make_pack_kernel, network_layout
from warp_neural.kernels.coopvec.network import make_network
from warp_neural.kernels.coopvec.rows import (
    BLOCK,
    can_read_together,
    make_evaluate_kernel,
    make_of_row,
    make_of_row_together,
)
from warp_neural.kernels.errors import require
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.encodings.base import Encoding
from warp_neural.kernels.nn.encodings.network import make_encode_kernel, make_encoded
from warp_neural.kernels.nn.mlp import make_layer_kernel, make_mlp, make_tiled_mlp
from warp_neural.kernels.nn.spec import INT8, NetworkSpec, Parameters, format_of, round_up, select_network
from warp_neural.nn.initialization import xavier_uniform

IMPLEMENTATIONS = {"cooperative": make_network, "per_thread": make_mlp, "tiled": make_tiled_mlp}


class MLP:
    """`count` networks n_in -> [encoding ->] width (`depth` times) -> n_out with one shape, in one pair of buffers.

    In a kernel that takes `params: net.Params`, `net.func(params, x)` evaluates network `params.network` for the
    `net.vec_in` x of the calling thread; `net.select(params, i)` is `params` with another network. Differentiable
    through `wp.Tape`: gradients reach `net.gradient` and x.

    encoding: of the n_in inputs, see `wn.encodings`; its parameters, if any, follow those of the networks in `master`.
    precision: the format of weights and of the vectors between layers, one of `FORMATS`. accumulation: "float32" or,
    for float16, e4m3 and e5m2, "float16". dtype: element type of the vectors, float or `wp.float16`. implementation:
    "cooperative" (tensor cores), "per_thread" (float32 loops) or "tiled" (whole blocks: see `make_tiled_mlp`); the
    last two read the float32 parameters whatever the precision. initialization: see `warp_neural.nn.initialization`;
    biases start at zero.

    After the float32 parameters in `master` have changed on the device, call `pack()`; with int8, `calibrate()`.
    """

    Params = Parameters

    def __init__(
        self,
        n_in: int,
        n_out: int,
        width: int = 64,
        depth: int = 3,
        *,
        encoding: Encoding | None = None,
        activation: Activation = activations.relu,
        output_activation: Activation = activations.linear,
        precision: str = "float16",
        accumulation: str = "float32",
        dtype: type = float,
        implementation: str = "cooperative",
        initialization: Callable[[np.random.Generator, int, int], np.ndarray] = xavier_uniform,
        count: int = 1,
        seed: int = 0,
        device: wp.DeviceLike = None,
    ):
        names = ", ".join(IMPLEMENTATIONS)
        require(implementation in IMPLEMENTATIONS, "implementation", implementation, f"one of {names}")
        if not 0 <= depth <= 8:
            raise InputError(f"depth={depth}: a network has 0 to 8 hidden layers")
        if count < 1:
            raise InputError(f"count={count}: at least one network is needed")
        dtype = wp.float32 if dtype is float else dtype
        if encoding and dtype is not wp.float32:
            raise InputError("dtype=float16 with an encoding: encodings give float32; leave dtype out")
        self.n_in, self.encoding = n_in, encoding
        sizes = (encoding.n_out(n_in) if encoding else n_in, *[width] * depth, n_out)
        self.spec = NetworkSpec(sizes, activation, output_activation, format_of(precision), accumulation, dtype)
        self.count, self.implementation = count, implementation
        rng = np.random.default_rng(seed)
        shapes = self.spec.layers * count
        layers = [np.hstack([initialization(rng, n, k).ravel(), np.zeros(n)]) for k, n in shapes]
        if encoding:
            layers.append(np.zeros(self.encoding_start - count * self.n_parameters))
            layers.append(rng.uniform(*encoding.initial, count * encoding.n_parameters(n_in)))
        self._calibration_inputs = np.random.default_rng(0).uniform(-1, 1, (256, n_in)).astype(np.float32)
        self._allocate(np.hstack(layers), wp.get_device(device))

    def _allocate(self, master: np.ndarray, device: wp.Device) -> None:
        """Every array on `device`, once: `pack()` and launches allocate nothing, so a CUDA graph can hold them."""
        spec, self.device = self.spec, device
        words = network_layout(spec, device.is_cuda)[1]
        self.words = words
        self.master = wp.array(master, dtype=float, device=device, requires_grad=True)  # networks, then encodings
        self.packed = wp.zeros(self.count * words, dtype=wp.uint32, device=device)
        self.table = wp.array(layer_table(spec, device.is_cuda), dtype=int, device=device)
        self.steps = wp.ones((self.count, len(spec.layers), 2), dtype=float, device=device)  # int8: input, weight
        self.params = Parameters()
        self.params.packed, self.params.master, self.params.network = self.packed, self.master, 0
        self._refresh()

    @property
    def vec_in(self) -> type:
        return wp.types.vector(self.n_in, self.spec.dtype)

    @property
    def vec_out(self) -> type:
        return self.spec.vec_out

    @property
    def n_out(self) -> int:
        return self.spec.sizes[-1]

    @property
    def depth(self) -> int:
        """Hidden layers."""
        return len(self.spec.layers) - 1

    @property
    def width(self) -> int:
        """Of the hidden layers; 0 without any."""
        return self.spec.sizes[1] if self.depth else 0

    @property
    def precision(self) -> str:
        return self.spec.format.name

    @property
    def n_parameters(self) -> int:
        """Of one network, without its encoding."""
        return self.spec.n_parameters

    @property
    def encoding_start(self) -> int:
        """Where the parameters of the encodings start in `master`, aligned to 16 bytes."""
        return round_up(self.count * self.n_parameters, 4)

    @property
    def gradient(self) -> wp.array:
        """Of `master`."""
        return self.master.grad

    @cached_property
    def func(self) -> wp.Function:
        """`(params: net.Params, x: net.vec_in) -> net.vec_out`, for any thread of any kernel."""
        network = IMPLEMENTATIONS[self.implementation](self.spec)
        return make_encoded(network, self.encode) if self.encoding else network

    @cached_property
    def encode(self) -> wp.Function:
        """The encoding alone, `(params, x: net.vec_in) -> vec`."""
        return self.encoding.make(self.n_in, self.encoding_start)

    @property
    def select(self) -> wp.Function:
        """`(params: net.Params, i: int) -> net.Params` with network i selected."""
        return select_network

    def pack(self) -> None:
        """Round `master` into the buffer that `func` reads: one launch, which a CUDA graph can hold."""
        cuda = self.device.is_cuda
        wp.launch(
            make_pack_kernel(self.spec.format, cuda, bias_is_half(self.spec, cuda)),
            dim=(self.count, self.words),
            inputs=[self.table, self.steps, self.master, self.n_parameters, self.packed, self.words],
            device=self.device,
            record_tape=False,
        )

    def evaluate(self, x: np.ndarray | wp.array) -> wp.array:
        """Network 0 of each row of x [n, n_in]: [n, n_out], both of the dtype of the vectors. Forward only."""
        dtype = self.spec.dtype
        if not isinstance(x, wp.array):
            x = wp.array(x, dtype=dtype, device=self.device)
        if x.ndim != 2 or x.shape[1] != self.n_in or x.dtype is not dtype or x.device != self.device:
            here, wanted = f"{x.shape} of {x.dtype.__name__}", f"[n, {self.n_in}] of {dtype.__name__}"
            raise InputError(f"inputs {here} on {x.device.alias}: expected {wanted} on {self.device.alias}")
        y = wp.empty((x.shape[0], self.spec.sizes[-1]), dtype=dtype, device=self.device)
        kernel, dim = make_evaluate_kernel(self.of_row, self.vec_out), round_up(x.shape[0], BLOCK)
        wp.launch(kernel, dim, [self.params, x, y], device=self.device, block_dim=BLOCK, record_tape=False)
        return y

    @cached_property
    def of_row(self) -> wp.Function:
        """`(params: net.Params, x: array2d [rows, n_in], row: int) -> net.vec_out`: `func` of a row. Forward only."""
        together = self.encoding is None and self.implementation == "cooperative" and can_read_together(self.spec)
        return make_of_row_together(self.spec, self.func) if together else make_of_row(self.func, self.vec_in)

    def to(self, device: wp.DeviceLike) -> "MLP":
        """Move to another device, gradients left behind; returns self."""
        device = wp.get_device(device)
        if device != self.device:
            self._allocate(self.master.numpy(), device)
        return self

    def calibrate(self, inputs: np.ndarray | None = None) -> None:
        """Set the int8 steps of each layer of each network from sample inputs [n, n_in], then pack.

        Inputs of a layer step by the largest that the float32 network sees there / 127, weights by their largest / 127.
        Without `inputs` the last ones are taken again, at first uniform random numbers in [-1, 1].
        """
        if inputs is not None:
            inputs = np.asarray(inputs, np.float32)
            if inputs.ndim != 2 or inputs.shape[1] != self.n_in or not len(inputs):
                raise InputError(f"calibration inputs {inputs.shape}: expected [n, {self.n_in}]")
            self._calibration_inputs = inputs
        samples, layers = len(self._calibration_inputs), self.spec.layers
        ranges = wp.zeros((self.count, len(layers)), dtype=float, device=self.device)
        h = np.broadcast_to(self._calibration_inputs, (self.count, *self._calibration_inputs.shape))
        h = wp.array(h, dtype=float, device=self.device)
        if self.encoding:
            h, x = wp.empty((self.count, samples, layers[0][0]), dtype=float, device=self.device), h
            inputs = [self.params, x, h]
            wp.launch(make_encode_kernel(self.encode), h.shape[:2], inputs, device=self.device, record_tape=False)
        for layer, (_, n_out) in enumerate(layers):
            y = wp.empty((self.count, samples, n_out), dtype=float, device=self.device)  # [network, sample, n_out]
            wp.launch(
                make_layer_kernel(self.spec.activation_of(layer)),
                dim=y.shape,
                inputs=[self.master, self.n_parameters, self.table, layer, h, ranges, y],
                device=self.device,
                record_tape=False,
            )
            h = y
        weights = np.stack([np.abs(w).reshape(self.count, -1).max(1) for w in self.weights], 1)
        largest = np.stack([ranges.numpy(), weights], -1)  # [count, layers, 2]
        self.steps.assign(np.where(largest > 0, largest, 1) / 127)
        self.pack()

    def _refresh(self) -> None:
        if self.spec.format is INT8:
            self.calibrate()
        else:
            self.pack()

    def _views(self, master: np.ndarray, part: int) -> list[np.ndarray]:
        """The weights (part 0) or biases (1) of each layer in `master`, with an axis of networks if several."""
        master, views, start = master[: self.count * self.n_parameters].reshape(self.count, -1), [], 0
        for n_in, n_out in self.spec.layers:
            weights = master[:, start : start + n_out * n_in].reshape(self.count, n_out, n_in)
            start += n_out * n_in + n_out
            view = weights if part == 0 else master[:, start - n_out : start]
            views.append(view if self.count > 1 else view[0])
        return views

    def _assign(self, values: list[np.ndarray], part: int) -> None:
        master = self.master.numpy().copy()
        for view, value in zip(self._views(master, part), values, strict=True):
            view[...] = value
        self.master.assign(master)
        self._refresh()

    @property
    def weights(self) -> list[np.ndarray]:
        """Of each layer, [n_out, n_in], or [count, n_out, n_in] for several networks; assign a list to set them."""
        return self._views(self.master.numpy().copy(), 0)

    @weights.setter
    def weights(self, values: list[np.ndarray]) -> None:
        self._assign(values, 0)

    @property
    def biases(self) -> list[np.ndarray]:
        """Of each layer, [n_out], or [count, n_out] for several networks; assign a list to set them."""
        return self._views(self.master.numpy().copy(), 1)

    @biases.setter
    def biases(self, values: list[np.ndarray]) -> None:
        self._assign(values, 1)
