"""`MLP`: a small fully connected network that any thread of any Warp kernel can call, and the arrays it reads."""

from collections.abc import Callable

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.coopvec.layout import bias_is_half, layer_table, make_pack_kernel, network_layout
from warp_neural.kernels.coopvec.rows import BLOCK
from warp_neural.kernels.coopvec.typed import kind_of
from warp_neural.kernels.errors import LARGEST, require_whole
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.encodings import Encoding
from warp_neural.kernels.nn.spec import INT8, Parameters
from warp_neural.nn.calibration import Calibration, set_weight_steps
from warp_neural.nn.evaluation import launch_rows
from warp_neural.nn.functions import Functions
from warp_neural.nn.initial_state import initial_state
from warp_neural.nn.initialization import xavier_uniform
from warp_neural.nn.state import NetworkState


class MLP(Functions):
    """`count` networks n_in -> [encoding ->] width (`depth` times) -> n_out with one shape, in one pair of buffers.

    In a kernel that takes `params: net.Params`, `net.func(params, x)` evaluates network `params.network` for the
    `net.vec_in` x of the calling thread; `net.select(params, i)` is `params` with another network. With parameters
    of another shape, or a network that is not there, the result is NaN. Differentiable
    through `wp.Tape`: gradients reach `net.gradient` and x. Not so in a loop that feeds results to its next trip, which
    Warp differentiates wrongly without a word: use `wn.autodiff.loop`, and `wn.autodiff.check` to be sure.

    encoding: of the n_in inputs, see `wn.encodings`; its parameters, if any, follow those of the networks in `master`.
    precision: the format of weights and of the vectors between layers, one of `FORMATS`. accumulation: "float32" or,
    for float16, e4m3 and e5m2, "float16". dtype: element type of the vectors, float or `wp.float16`. implementation:
    "cooperative" (tensor cores), "per_thread" (float32 loops) or "tiled" (whole blocks: see `make_tiled_mlp`); the
    last two read the float32 parameters whatever the precision. initialization: see `wn.initialization`; biases start
    at zero.

    int8 rounds to steps. Those of a layer's weights follow the weights whenever they are packed; those of its inputs
    are set by `calibrate`, at first from random inputs in [-1, 1], and by a `Trainer` as it goes. They are part of
    `state`, what the network is: files, copies, pickles and other devices get all of it.

    After the float32 parameters in `master` have changed on the device, call `pack()`.
    """

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
        kind = encoding, activation, output_activation, precision, accumulation, dtype, implementation
        state = initial_state(n_in, n_out, width, depth, *kind, initialization, count, seed)
        self._allocate(state, find_device(device))

    @classmethod
    def from_state(cls, state: NetworkState, *, device: wp.DeviceLike = None) -> "MLP":
        """The network of a state, equal bit for bit, on `device` (the current one by default)."""
        hidden = state.spec.sizes[1:-1]
        if len(set(hidden)) > 1:
            raise InputError(f"hidden layers of sizes {hidden}; an MLP has one width: train it with one")
        net = cls.__new__(cls)
        net._allocate(state, find_device(device))
        return net

    def _allocate(self, state: NetworkState, device: wp.Device) -> None:
        """Every array on `device`, once: `pack()` and launches allocate nothing, so a CUDA graph can hold them."""
        spec = self.spec = state.spec
        self.count, self.implementation, self.encoding, self.n_in = state.count, *state.kind[2:]
        self.device = device
        self.words = network_layout(spec, device.is_cuda)[1]
        n = self.encoding_start + state.encoding_parameters.size if self.encoding else state.parameters.size
        master = wp.zeros(n, dtype=float, device=device, requires_grad=True)  # networks, then encodings
        self.packed = wp.zeros(self.count * self.words, dtype=wp.uint32, device=device)
        self.table = wp.array(layer_table(spec, device.is_cuda), dtype=int, device=device)
        self.steps = wp.ones((self.count, len(spec.layers), 2), dtype=float, device=device)  # int8: input, weight
        self.Params = self.params_type()
        self.params, self.plain = self.Params(), Parameters()
        for params in (self.params, self.plain):
            params.packed, params.network = self.packed, 0
            params.count, params.kind = self.count, kind_of(self.Params)
        self._use(master)
        self.load_state(state)

    def _use(self, master: wp.array) -> None:
        self.master = self.params.master = self.plain.master = master

    def share(self, master: wp.array) -> None:
        """Keep the parameters in `master` from now on, float32 [master.size] in this order, and take its values.

        For memory that another library changes too; call `pack()` when it has. Not for a network whose `Trainer` there
        is already.
        """
        if (master.dtype, master.shape, master.device) != (wp.float32, self.master.shape, self.device):
            here = f"{master.dtype.__name__} {master.shape} on {master.device.alias}"
            raise InputError(f"share: {here}; expected float32 {self.master.shape} on {self.device.alias}")
        if not master.is_contiguous or master.ptr % 16:
            raise InputError("share: memory with gaps, or not aligned to 16 bytes; give a copy")
        master.requires_grad = True
        self._use(master)
        self.pack()

    @property
    def state(self) -> NetworkState:
        """What the network is, a copy on the host."""
        master, n = self.master.numpy(), self.count * self.spec.n_parameters
        own = master[self.encoding_start :] if self.encoding else None
        steps = self.steps.numpy() if self.spec.format is INT8 else None
        kind = self.count, self.implementation
        return NetworkState(self.spec, master[:n], *kind, steps, self.encoding, self.n_in, own, self.extra)

    def load_state(self, state: NetworkState) -> None:
        """Take the numbers of a state: parameters, int8 steps and `extra`. Raises `InputError` for another network."""
        self.require_kind(state)
        master = np.zeros(self.master.size, np.float32)
        master[: state.parameters.size] = state.parameters.ravel()
        if self.encoding:
            master[self.encoding_start :] = state.encoding_parameters.ravel()
        self.master.assign(master)
        self.extra = dict(state.extra)
        if state.steps is not None:
            self.steps.assign(state.steps)
            self.pack()
        elif self.spec.format is INT8:
            self.calibrate(np.random.default_rng(0).uniform(-1, 1, (256, self.n_in)))
        else:
            self.pack()

    def __reduce__(self):
        """Copies and pickles are on the same device; where there is none of its name, on the current one."""
        return _restore, (self.state, self.device.alias)

    def __repr__(self) -> str:
        return f"MLP({self.description}, {self.device.alias})"

    @property
    def gradient(self) -> wp.array:
        """Of `master`."""
        return self.master.grad

    def pack(self, source: wp.array | None = None) -> None:
        """Round `master` into the buffer that `func` reads: a launch, int8 a few, which a CUDA graph can hold.

        source: float32 [master.size], what to take instead; not for int8.
        """
        cuda = self.device.is_cuda
        if self.spec.format is INT8:
            set_weight_steps(self)
        wp.launch(
            make_pack_kernel(self.spec.format, cuda, bias_is_half(self.spec, cuda)),
            dim=(self.count, self.words),
            inputs=[
                self.table,
                self.steps,
                self.master if source is None else source,
                self.spec.n_parameters,
                self.packed,
                self.words,
            ],
            device=self.device,
            record_tape=False,
        )

    def evaluate(self, x: np.ndarray | wp.array) -> wp.array:
        """Network 0 of each row of x [n, n_in]: [n, n_out], both of the dtype of the vectors. Forward only."""
        dtype = self.spec.dtype
        require_whole("rows", (*np.shape(x), 0)[0], 0, LARGEST - BLOCK)
        if not isinstance(x, wp.array):
            x = wp.array(x, dtype=dtype, device=self.device)
        if x.ndim != 2 or x.shape[1] != self.n_in or x.dtype is not dtype or x.device != self.device:
            here, wanted = f"{x.shape} of {x.dtype.__name__}", f"[n, {self.n_in}] of {dtype.__name__}"
            raise InputError(f"inputs {here} on {x.device.alias}: expected {wanted} on {self.device.alias}")
        y = wp.empty((x.shape[0], self.spec.sizes[-1]), dtype=dtype, device=self.device)
        launch_rows(self, self.plain, x, y)
        return y

    def to(self, device: wp.DeviceLike) -> "MLP":
        """Move to another device, gradients left behind; returns self."""
        device = find_device(device)
        if device != self.device:
            self._allocate(self.state, device)
        return self

    def calibrate(self, inputs: np.ndarray) -> None:
        """int8: set the step of each layer's inputs from sample inputs [n, n_in], then pack.

        A step is the largest that the float32 network meets there / 127; larger ones saturate. Calibrate again after
        you have set other weights, whose own steps follow them.
        """
        if self.spec.format is not INT8:
            raise InputError(f"calibrate: {self.precision} needs no steps; make the MLP with precision='int8'")
        inputs = np.asarray(inputs, np.float32)
        if inputs.ndim != 2 or inputs.shape[1] != self.n_in or not len(inputs) or not np.isfinite(inputs).all():
            raise InputError(f"calibration inputs {inputs.shape}: expected [n, {self.n_in}], finite")
        Calibration(self, len(inputs)).run(wp.array(inputs, dtype=float, device=self.device))

    @property
    def weights(self) -> list[np.ndarray]:
        """Of each layer, [n_out, n_in], or [count, n_out, n_in] for several networks; assign a list to set them.

        Read-only copies.
        """
        return self.state.weights

    @weights.setter
    def weights(self, values: list[np.ndarray]) -> None:
        self.load_state(self.state.with_layers(weights=values))

    @property
    def biases(self) -> list[np.ndarray]:
        """Of each layer, [n_out], or [count, n_out] for several networks; assign a list to set them. As `weights`."""
        return self.state.biases

    @biases.setter
    def biases(self, values: list[np.ndarray]) -> None:
        self.load_state(self.state.with_layers(biases=values))


def _restore(state: NetworkState, alias: str) -> MLP:
    there = {device.alias for device in wp.get_devices()}
    return MLP.from_state(state, device=alias if alias in there else None)
