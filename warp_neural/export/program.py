"""A network as a program of statements: encoding, layers, activations, roundings."""

import hashlib
import re
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from warp_neural.errors import InputError
from warp_neural.export.encodings import encode
from warp_neural.export.statements import Array, Block, For, Layer, Let, Set, Statement, without_ternaries
from warp_neural.export.unrolled import WIDEST
from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.spec import FORMATS, format_of
from warp_neural.nn.mlp import MLP
from warp_neural.nn.state import NetworkState

PRECISIONS = "float32", "float16"
INFINITE = 65520.0  # in float16, and all beyond
FUNCTIONS = {"exp", "log", "tanh", "erf", "sin", "cos", "sqrt", "abs"}


@dataclass(frozen=True, eq=False)
class Program:
    """`x` [n_in] to `y` [n_out] for a network of one. precision: float32, or float16 of weights and of vectors between
    layers, with sums in float32.

    by_inputs: weights of a layer lie [n_in, n_out], as CPUs sum them, else row major, [n_out, n_in]. unrolled: layers
    are `Layer`s, `weights` only the encoding's parameters, and vectors between layers float32 whatever the precision:
    `to_half` would take longer than the products.
    """

    state: NetworkState
    precision: str
    by_inputs: bool = False
    unrolled: bool = False

    def __post_init__(self) -> None:
        if self.state.count != 1:
            raise InputError(f"{self.state.count} networks in one; save them one by one, each is exported alone")
        check_finite(self.state)
        if self.precision == "float16":
            fit_float16("weight", self.state.weights)
        if self.unrolled and (widest := max(self.state.spec.sizes)) > WIDEST:
            raise InputError(f"a layer of {widest}: as constants they have up to {WIDEST}; give target wgsl, not baked")
        for activation in {self.state.spec.activation, self.state.spec.output_activation}:
            portable(activation)

    @property
    def n_in(self) -> int:
        return self.state.n_in

    @property
    def n_out(self) -> int:
        return self.state.spec.sizes[-1]

    @cached_property
    def weights(self) -> np.ndarray:
        """Of each layer weights, then biases; then the encoding's parameters; float32."""
        parts = []
        for l, b in enumerate(self.state.biases if not self.unrolled else ()):
            w = self._rounded(l)
            parts += [(w.T if self.by_inputs else w).ravel(), b]
        return np.concatenate([*parts, self.state.encoding_parameters.ravel()])

    def _rounded(self, l: int) -> np.ndarray:
        """Weights of a layer, [n_out, n_in]."""
        w = self.state.weights[l]
        return w.astype(np.float16).astype(np.float32) if self.precision == "float16" else w

    @property
    def digest(self) -> str:
        return digest_of(self.state, self.precision)

    @cached_property
    def encoded(self) -> tuple[Statement, ...]:
        """`h0`, what the first layer takes, not rounded yet."""
        spec, encoding = self.state.spec, self.state.encoding
        x = tuple(f"x[{i}]" for i in range(self.n_in))
        statements: list[Statement] = [Array("h0", spec.sizes[0])]
        if encoding:
            encoded = encode(encoding, x, 0, 0 if self.unrolled else spec.n_parameters)
            statements.append(Block(type(encoding).__name__, tuple(encoded)))
        else:
            statements += [Set(f"h0[{i}]", value) for i, value in enumerate(x)]
        return tuple(statements)

    @cached_property
    def body(self) -> tuple[Statement, ...]:
        spec, statements = self.state.spec, list(self.encoded)
        if self.precision == "float16" and not self.unrolled:
            statements.append(For("i_input", spec.sizes[0], (Set("h0[i_input]", "to_half(h0[i_input])"),)))
        for l in range(len(spec.layers)):
            statements += self._layer(l)
        return tuple(statements)

    def _layer(self, l: int) -> list[Statement]:
        spec = self.state.spec
        (n_in, n_out), last = spec.layers[l], l == len(spec.layers) - 1
        start = spec.offsets[l]
        if self.unrolled:
            target, weights, biases = "y" if last else f"h{l + 1}", self._rounded(l), self.state.biases[l]
            result = portable(spec.activation_of(l))
            return [Layer(f"h{l}", target, weights, biases, result, first=l == 0, last=last)]
        biases, sums = start + n_in * n_out, f"sums{l}"
        n, k, m, o = (f"{name}{l}" for name in ("n", "k", "m", "o"))
        begin = For(m, n_out, (Set(f"{sums}[{m}]", f"weights[{biases} + {m}]"),))
        place = f"{start} + {k} * {n_out} + {n}" if self.by_inputs else f"{start} + {n} * {n_in} + {k}"
        term = Set(f"{sums}[{n}]", f"multiply_add(h{l}[{k}], weights[{place}], {sums}[{n}])")
        loops = ((k, n_in), (n, n_out)) if self.by_inputs else ((n, n_out), (k, n_in))
        (outer, outer_count), (inner, inner_count) = loops
        products = For(outer, outer_count, (For(inner, inner_count, (term,)),))
        result = self.activated(l)
        if (self.precision == "float16" and not last) or (last and spec.dtype.__name__ == "float16"):
            result = f"to_half({result})"
        target = f"y[{o}]" if last else f"h{l + 1}[{o}]"
        finish = For(o, n_out, (Let(f"z{l}", "float", f"{sums}[{o}]"), Set(target, result)))
        arrays = [Array(sums, n_out)] + ([] if last else [Array(f"h{l + 1}", n_out)])
        return [*arrays, begin, products, finish]

    def activated(self, l: int) -> str:
        """What layer l makes of its sum `z{l}`, an expression."""
        return re.sub(r"\bz\b", f"z{l}", portable(self.state.spec.activation_of(l)))


def network_of(state: NetworkState, precision: str | None) -> MLP:
    """On the CPU, of another precision if one is given, with sums in float32 then."""
    spec = state.spec
    if precision:
        spec = replace(spec, format=format_of(precision), accumulation="float32")
    return MLP.from_state(replace(state, spec=spec, implementation="cooperative"), device="cpu")


def evaluated(net: MLP, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of inputs as the network takes them, and what it makes of them, float32."""
    given = inputs.astype(np.float16) if net.spec.dtype.__name__ == "float16" else inputs
    return given.astype(np.float32), net.evaluate(given).numpy().astype(np.float32)


def make_program(
    state: NetworkState, precision: str | None = None, by_inputs: bool = False, unrolled: bool = False
) -> Program:
    """precision: that of the network if None. Raises `InputError` for what cannot be expressed."""
    spec = state.spec
    if precision is None:
        precision = spec.format.name
        if precision not in PRECISIONS or spec.accumulation != "float32":
            raise InputError(
                f"a network of {precision} with sums in {spec.accumulation}: exports are of float32, or of float16 "
                "with sums in float32; give precision float16, the nearest"
            )
    if precision not in PRECISIONS:
        known = "is not exported yet" if precision in FORMATS else "is unknown"
        raise InputError(f"precision {precision}: {known}; give one of {', '.join(PRECISIONS)}")
    return Program(state, precision, by_inputs, unrolled)


def check_finite(state: NetworkState) -> None:
    if not all(np.isfinite(x).all() for x in (state.parameters, state.encoding_parameters)):
        raise InputError("the parameters hold NaN or infinite values; train the network again")


def fit_float16(what: str, arrays: list[np.ndarray]) -> None:
    """Raises `InputError` for what would be infinite."""
    if (largest := max(np.abs(each).max() for each in arrays)) >= INFINITE:
        raise InputError(f"a {what} of size {largest:g} is beyond float16; give precision float32")


def digest_of(state: NetworkState, precision: str) -> str:
    """Of all that makes the network, 16 hexadecimal digits."""
    text = f"{state.spec} {state.encoding} {precision}".encode()
    data = state.parameters.tobytes() + state.encoding_parameters.tobytes()
    return hashlib.sha256(text + data).hexdigest()[:16]


def portable(activation: Activation) -> str:
    """Its expression of `z` as statements have them. Raises `InputError` for functions that they do not have."""
    words = set(re.findall(r"\b[A-Za-z_]\w*", re.sub(r"\b[\d.]+(e[-+]?\d+)?f\b", "", activation.value)))
    unknown = words - FUNCTIONS - {"z", "wp"}
    if unknown:
        raise InputError(f"activation {activation.name!r} calls {', '.join(sorted(unknown))}, which is not exported")
    return without_ternaries(activation.value.replace("wp::", "").replace("tanh(", "tanh_of("))
