"""What all encodings share: the text of one encoding becomes a function of the thread, its adjoint, or part of another.

The C++ text of an encoding sees these names, each a pointer to floats: `in` [n_in], `out` [n_out] and `p`, its
trainable parameters; the adjoint's text also `d_out`, `d_in`, to which it adds, and `grad`, of the parameters, or null.
Constants say what is to be done, `WHOLE` everything: part `part` of `parts` of the results, which `out` or `d_out`
holds alone, thread `lane` of the `lanes` that do it together (what they set or add is summed); and in the adjoint, if
`shared_sums`, parameters that are summed so (see `Encoding.shared_sums`), and if `direct_sums`, the others.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import gcd
from typing import NamedTuple

import warp as wp

from warp_neural.kernels.errors import LARGEST, is_finite, require, require_whole
from warp_neural.kernels.native import ATOMICS
from warp_neural.kernels.nn.spec import Parameters

UNROLL = """
#if defined(__CUDA_ARCH__)
#pragma unroll
#endif
"""

WHOLE = "constexpr int part = 0, parts = 1, lane = 0, lanes = 1;\n"
WHOLE += "constexpr bool shared_sums = true, direct_sums = true;\n"

ENTER_ADJOINT = f"real* const grad = params.master.grad ? params.master.grad + start : nullptr;\n{ATOMICS}"


@dataclass(frozen=True)
class Encoding(ABC):
    """A function of n_in inputs with n_out results, for the front of a network; some have trainable parameters.

    `initial`: uniform range of fresh parameters. Sizes that an encoding cannot take are an `InputError`.
    """

    @property
    def initial(self) -> tuple[float, float]:
        return 0.0, 0.0

    @property
    def sparse(self) -> bool:
        """Whether parameters whose gradient is exactly 0 rest in that step of a `Trainer`, and so do their moments.

        A batch reaches few entries of a large table (Mueller et al. 2022, section 4).
        """
        return True

    @property
    def n_parts(self) -> int:
        """Into how many parts of equal size the results are cut, for threads of their own in a CUDA kernel of many
        samples."""
        return 1

    @property
    def lanes(self) -> int:
        """Threads that take a part together there: 1, 2, 4, ... of a warp, side by side."""
        return 1

    def shared_sums(self, n_in: int) -> int:
        """How many parameters, the first ones, have their gradients summed in a block's shared memory first: so many
        samples meet there that they would queue in memory."""
        return 0

    def leaves(self, n_in: int) -> list["Leaf"]:
        """The encodings that it consists of, which can be run one by one."""
        return [Leaf(self, tuple(range(n_in)), 0, 0)]

    @abstractmethod
    def n_out(self, n_in: int) -> int:
        """Results for as many inputs."""

    def n_parameters(self, n_in: int) -> int:
        """Trainable float32 parameters."""
        return 0

    def make(self, n_in: int, offset: int = 0, stride: int | None = None) -> wp.Function:
        """`(params: Parameters, x: vec of n_in float32) -> vec of n_out float32`, for any thread of any kernel.

        The parameters of network i lie in `params.master` from `offset + i * stride` on; `stride` is `n_parameters` if
        not given. Offsets and strides that are multiples of 4 are read and added to in whole vectors. Differentiable
        through `wp.Tape` in x and in `params.master`.
        """
        return make_encode(self, n_in, offset, self.n_parameters(n_in) if stride is None else stride)

    def make_adjoint(self, n_in: int, offset: int = 0, stride: int | None = None) -> wp.Function | None:
        """`(params: Parameters, x, dy: vec of n_out) -> None`: adds the parameters' gradient to `params.master.grad`.

        For kernels that are not differentiated themselves. None for encodings without parameters.
        """
        if self.n_parameters(n_in) == 0:
            return None
        return make_encode_adjoint(self, n_in, offset, self.n_parameters(n_in) if stride is None else stride)

    @abstractmethod
    def encode_text(self, n_in: int, aligned: int) -> str:
        """C++ that sets every `out`; `p` is aligned to `aligned` floats, 1, 2 or 4."""

    @abstractmethod
    def adjoint_text(self, n_in: int, aligned: int) -> str:
        """C++ that adds to `d_in` and, unless it is null, to `grad`."""


class Leaf(NamedTuple):
    """An encoding within another: the inputs that it reads, and where its results and its parameters start there."""

    encoding: Encoding
    inputs: tuple[int, ...]
    result: int
    parameter: int


@cache
def make_encode(encoding: Encoding, n_in: int, offset: int, stride: int) -> wp.Function:
    """`Encoding.make`."""
    n_out, aligned = encoding.n_out(n_in), gcd(offset, stride, 4)
    vec_in, vec_out = wp.types.vector(n_in, float), wp.types.vector(n_out, float)
    forward = f"wp::vec_t<{n_out}, real> y;\nreal* const out = y.c;\n{encoding.encode_text(n_in, aligned)}return y;\n"
    pointers = "const real* const d_out = adj_ret.c;\nreal* const d_in = adj_x.c;\n"

    begin = WHOLE + enter(range(n_in), offset, stride)

    @wp.func_native(
        begin + forward,
        adj_snippet=begin + ENTER_ADJOINT + pointers + encoding.adjoint_text(n_in, aligned),
    )
    def encode(params: Parameters, x: vec_in) -> vec_out: ...

    return encode


@cache
def make_encode_adjoint(encoding: Encoding, n_in: int, offset: int, stride: int) -> wp.Function:
    """`Encoding.make_adjoint`."""
    vec_in, vec_out = wp.types.vector(n_in, float), wp.types.vector(encoding.n_out(n_in), float)

    pointers = f"const real* const d_out = dy.c;\nreal unused[{n_in}] = {{}};\nreal* const d_in = unused;\n"

    begin = WHOLE + enter(range(n_in), offset, stride) + ENTER_ADJOINT + pointers

    @wp.func_native(begin + encoding.adjoint_text(n_in, gcd(offset, stride, 4)))
    def encode_adjoint(params: Parameters, x: vec_in, dy: vec_out): ...

    return encode_adjoint


@cache
def make_encode_gradient(encoding: Encoding, n_in: int, offset: int) -> wp.Function:
    """`(params: Parameters, x, dy: vec of n_out) -> dx`: adds to `params.master.grad`, unless that is null.

    Of network 0, for kernels that are not differentiated themselves.
    """
    vec_in, vec_out = wp.types.vector(n_in, float), wp.types.vector(encoding.n_out(n_in), float)
    begin = WHOLE + enter(range(n_in), offset, 0) + ENTER_ADJOINT
    begin += f"wp::vec_t<{n_in}, real> dx;\nconst real* const d_out = dy.c;\nreal* const d_in = dx.c;\n"

    @wp.func_native(f"{begin}{encoding.adjoint_text(n_in, gcd(offset, 4))}return dx;\n")
    def encode_gradient(params: Parameters, x: vec_in, dy: vec_out) -> vec_in: ...

    return encode_gradient


def enter(inputs: Sequence[int], offset: int, stride: int) -> str:
    return f"""using real = wp::float32;
const wp::int64 start = {offset} + wp::int64(params.network) * {stride};
const real in[] = {{{", ".join(f"x.c[{i}]" for i in inputs)}}};
const real* const p = params.master.data + start;
"""


def read_entry(count: int, aligned: int, place: str) -> str:
    """Statements that read `count` floats at `place`, aligned to `aligned`, into a new array `v`."""
    width = gcd(count, aligned)
    if width == 1:
        load = "v[c] = __ldg(entry + c);"
    else:
        load = f"const float{width} q = __ldg(reinterpret_cast<const float{width}*>(entry + c)); "
        load += " ".join(f"v[c + {i}] = q.{axis};" for i, axis in enumerate("xyzw"[:width]))
    return f"""const real* const entry = {place};
real v[{count}];
#if defined(__CUDA_ARCH__)
#pragma unroll
for (int c = 0; c < {count}; c += {width}) {{ {load} }}
#else
for (int c = 0; c < {count}; ++c) v[c] = entry[c];
#endif
"""


def add_entry(count: int, aligned: int, place: str, weight: str, values: str) -> str:
    """Statements that add `weight` times the `count` floats of array `values` to the gradient at `place`."""
    width = gcd(count, aligned)
    terms = ", ".join(f"{weight} * {values}[c + {i}]" for i in range(width))
    return f"""real* const target = {place};{UNROLL}
for (int c = 0; c < {count}; c += {width}) add{width if width > 1 else ""}(target + c, {terms});
"""


def number(value: float) -> str:
    """A float literal."""
    return f"{float(value)!r}f"


def numbers(values) -> str:
    """The inside of an initializer."""
    return ", ".join(number(value) for value in values)


def require_sizes(encoding: Encoding, *names: str, high: int = LARGEST) -> None:
    """Whole numbers from 1 on."""
    for name in names:
        require_whole(f"{type(encoding).__name__}: {name}", getattr(encoding, name), 1, high)


def require_range(encoding: Encoding) -> None:
    """Of `initial`."""
    ends = encoding.initial
    valid = isinstance(ends, tuple) and len(ends) == 2 and all(map(is_finite, ends)) and ends[0] <= ends[1]
    require(valid, f"{type(encoding).__name__}: initial", ends, "a range of two finite numbers, the smaller first")


def require_inputs(encoding: Encoding, n_in: int, low: int, high: int) -> None:
    require_whole(f"{type(encoding).__name__}: n_in", n_in, low, high)
