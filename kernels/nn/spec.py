"""What a cooperative network is made of: number formats, sizes, activations, and where each parameter lies."""

from dataclasses import dataclass
from functools import cached_property

import warp as wp

from warp_neural.kernels.errors import InputError, require, require_whole
from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.activations import Activation


@dataclass(frozen=True)
class Format:
    """A number format of matrix and vector elements inside the products.

    bits: storage of one element. k_step: depth K of one `mma.sync` (0: per-thread arithmetic). min_arch: the oldest
    CUDA architecture whose tensor cores multiply it. largest: the largest finite value, where conversion saturates.
    """

    name: str
    bits: int
    k_step: int
    min_arch: int
    largest: float

    def __reduce__(self):  # copies and pickles are the same object
        return format_of, (self.name,)

    @property
    def per_word(self) -> int:
        """Elements in one 32-bit register."""
        return 32 // self.bits


FLOAT32 = Format("float32", 32, 0, 0, 3.4028235e38)
TF32 = Format("tf32", 32, 8, 80, 3.4028235e38)
FLOAT16 = Format("float16", 16, 16, 80, 65504.0)
BFLOAT16 = Format("bfloat16", 16, 16, 80, 3.3895314e38)
E4M3 = Format("e4m3", 8, 32, 89, 448.0)
E5M2 = Format("e5m2", 8, 32, 89, 57344.0)
INT8 = Format("int8", 8, 32, 80, 127.0)

C_TYPES = {wp.float32: "wp::float32", wp.float16: "wp::half"}  # of the vectors' elements, in native text

MAX_SIZE, MAX_LAYERS = 256, 9  # of one vector; products in a network

FORMATS = {f.name: f for f in (FLOAT32, TF32, FLOAT16, BFLOAT16, E4M3, E5M2, INT8)}


def format_of(precision: str, name: str = "precision") -> Format:
    """The format that public functions know by its name; `name` is the argument's, for the error."""
    require(isinstance(precision, str) and precision in FORMATS, name, precision, f"one of {', '.join(FORMATS)}")
    return FORMATS[precision]


def check_vector(n: int, dtype: type) -> None:
    """Raise `InputError` for a size or an element type that vectors do not have."""
    require_whole("n", n, 1, MAX_SIZE)
    require(dtype in C_TYPES, "dtype", dtype, "wp.float32 or wp.float16, the vectors' element type")


def accumulations(format: Format) -> tuple[str, ...]:
    """In which types its products are summed; int8 always in int32, for which "float32" stands."""
    return ("float32", "float16") if format in (FLOAT16, E4M3, E5M2) else ("float32",)


def check_accumulation(format: Format, accumulation: str) -> None:
    require(accumulation in ("float32", "float16"), "accumulation", accumulation, "one of float32, float16")
    if accumulation not in accumulations(format):
        raise InputError(
            f"accumulation='float16': {format.name} accumulates in float32 only; float16, e4m3 and e5m2 in float16 too"
        )


@dataclass(frozen=True)
class NetworkSpec:
    """A fully connected network: `sizes` = (n_in, hidden..., n_out); one pair is a single matrix product.

    format: of weights and of the vectors between layers. accumulation: "float32" or "float16" (INT8 always accumulates
    in int32). dtype: `wp.float32` or `wp.float16`, the element type of the vectors that callers pass and get.
    """

    sizes: tuple[int, ...]
    activation: Activation = activations.relu
    output_activation: Activation = activations.linear
    format: Format = FLOAT16
    accumulation: str = "float32"
    dtype: type = wp.float32

    def __post_init__(self):
        if not (2 <= len(self.sizes) <= MAX_LAYERS + 1 and all(1 <= size <= MAX_SIZE for size in self.sizes)):
            raise InputError(f"sizes {self.sizes}: a network has 1 to {MAX_LAYERS} layers of sizes 1 to {MAX_SIZE}")
        check_accumulation(self.format, self.accumulation)
        require(self.dtype in C_TYPES, "dtype", self.dtype, "wp.float32 or wp.float16, the vectors' element type")

    @property
    def layers(self) -> list[tuple[int, int]]:
        """(n_in, n_out) of each layer."""
        return list(zip(self.sizes[:-1], self.sizes[1:], strict=True))

    def activation_of(self, layer: int) -> Activation:
        return self.output_activation if layer == len(self.sizes) - 2 else self.activation

    @cached_property
    def offsets(self) -> list[int]:
        """Where each layer's master parameters start."""
        return [sum(n * k + n for k, n in self.layers[:index]) for index in range(len(self.layers))]

    @cached_property
    def n_parameters(self) -> int:
        """Float32 master parameters of one network: for each layer weights [n_out, n_in] row major, then biases."""
        return sum(n * k + n for k, n in self.layers)

    @property
    def vec_in(self) -> type:
        return wp.types.vector(self.sizes[0], self.dtype)

    @property
    def vec_out(self) -> type:
        return wp.types.vector(self.sizes[-1], self.dtype)


@wp.struct
class Parameters:
    """Parameters of one or more networks of one `NetworkSpec`, as device code takes them.

    packed: weights and biases rounded to the format, in the device's inferencing-optimal layout, all networks.
    master: float32, `NetworkSpec.n_parameters` a network, row major; its `grad` receives the gradient.
    network: which of the `count` networks in the buffers a thread evaluates; threads of one warp may differ.
    kind: see `kernels.coopvec.typed`, whose types users have.
    """

    packed: wp.array[wp.uint32]
    master: wp.array[float]
    network: int
    count: int
    kind: int


@wp.func
def select_network(params: Parameters, network: int) -> Parameters:
    """`params` with another of its networks."""
    selected = params
    selected.network = network
    return selected


def round_up(value: int, multiple: int) -> int:
    return -(-value // multiple) * multiple
