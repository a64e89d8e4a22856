"""`NetworkState`: what a network is, on the host."""

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from warp_neural.errors import InputError
from warp_neural.kernels.coopvec.layout import network_layout
from warp_neural.kernels.errors import LARGEST, require, require_whole
from warp_neural.kernels.nn.encodings import Encoding
from warp_neural.kernels.nn.spec import INT8, NetworkSpec
from warp_neural.nn.kind import IMPLEMENTATIONS, Kind


@dataclass(frozen=True, eq=False, repr=False)
class NetworkState(Kind):
    """All that makes a network (see `MLP`), in read-only arrays: what files, devices and copies pass on.

    spec: sizes after the encoding, activations, format, accumulation, element type of vectors. parameters: float32
    [count, spec.n_parameters], of each layer weights [n_out, n_in] row major, then biases. steps: of INT8, float32
    [count, layers, 2], of a layer's inputs and weights; None: not calibrated yet. n_in: inputs of the encoding, or of
    the network. encoding_parameters: float32 [count, encoding.n_parameters(n_in)]. extra: what else a file is to hold,
    of plain JSON values.
    """

    spec: NetworkSpec
    parameters: np.ndarray
    count: int = 1
    implementation: str = "cooperative"
    steps: np.ndarray | None = None
    encoding: Encoding | None = None
    n_in: int | None = None
    encoding_parameters: np.ndarray | None = None
    extra: dict = field(default_factory=dict)

    def __post_init__(self):
        spec, n_in = self.spec, self.spec.sizes[0] if self.n_in is None else self.n_in
        check_size(self.count, spec, self.encoding, n_in)
        names = ", ".join(IMPLEMENTATIONS)
        require(self.implementation in IMPLEMENTATIONS, "implementation", self.implementation, f"one of {names}")
        given = self.encoding.n_out(n_in) if self.encoding else n_in
        if given != spec.sizes[0]:
            raise InputError(f"n_in={n_in}: {given} values to a network that takes {spec.sizes[0]}; make them agree")
        if self.encoding and spec.dtype.__name__ != "float32":
            raise InputError(f"dtype={spec.dtype.__name__} with an encoding: encodings give float32; leave dtype out")
        n = self.encoding.n_parameters(n_in) if self.encoding else 0
        own = np.zeros(self.count * n) if self.encoding_parameters is None else self.encoding_parameters
        steps = self.steps if spec.format is INT8 else None
        values = {
            "n_in": n_in,
            "parameters": _read_only("parameters", self.parameters, (self.count, spec.n_parameters)),
            "encoding_parameters": _read_only("encoding_parameters", own, (self.count, n)),
            "steps": None if steps is None else _read_only("steps", steps, (self.count, len(spec.layers), 2)),
        }
        if steps is not None and not (values["steps"] > 0).all():
            raise InputError("steps: not all are positive; give the largest input and weight of each layer / 127")
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __reduce__(self):
        """Copies and pickles check again, and stay read-only."""
        return type(self), tuple(getattr(self, f.name) for f in fields(self))

    def __repr__(self) -> str:
        return f"NetworkState({self.description})"

    @property
    def weights(self) -> list[np.ndarray]:
        """Of each layer, [n_out, n_in], or [count, n_out, n_in] for several networks."""
        return layers_of(self.spec, self.parameters)[0]

    @property
    def biases(self) -> list[np.ndarray]:
        """Of each layer, [n_out], or [count, n_out] for several networks."""
        return layers_of(self.spec, self.parameters)[1]

    @classmethod
    def of_layers(cls, spec: NetworkSpec, weights: list, biases: list, count: int = 1, **others: Any) -> "NetworkState":
        """From the weights and biases of each layer."""
        empty = cls(spec, np.zeros((count, spec.n_parameters)), count, **others)
        return empty.with_layers(weights, biases)

    def with_layers(self, weights: list | None = None, biases: list | None = None) -> "NetworkState":
        """The same network with other weights, biases or both."""
        parameters = self.parameters.copy()
        for name, views, values in zip(
            ("weights", "biases"), layers_of(self.spec, parameters), (weights, biases), strict=True
        ):
            if values is None:
                continue
            n = len(values) if isinstance(values, list | tuple) else type(values).__name__
            if n != len(views):
                raise InputError(f"{name}: a list of {n} arrays; give one for each of {len(views)} layers")
            for layer, (view, value) in enumerate(zip(views, values, strict=True)):
                view[...] = _fitted(f"{name} of layer {layer}", value, view.shape)
        return replace(self, parameters=parameters)


def check_size(count: int, spec: NetworkSpec, encoding: Encoding | None, n_in: int) -> None:
    """That indices into the buffers of `count` networks fit; nothing is allocated before."""
    own = encoding.n_parameters(n_in) if encoding else 0
    require_whole(f"parameters of {type(encoding).__name__}", own, 0, LARGEST // 2)
    words = max(network_layout(spec, cuda)[1] for cuda in (False, True))
    require_whole("count", count, 1, LARGEST // max(words, spec.n_parameters + own))


def layers_of(spec: NetworkSpec, parameters: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Views of the weights and of the biases of each layer, with an axis of networks if `parameters` has several."""
    count = parameters.size // spec.n_parameters
    parameters, weights, biases = parameters.reshape(count, -1), [], []
    for (k, n), start in zip(spec.layers, spec.offsets, strict=True):
        middle = start + n * k
        pair = parameters[:, start:middle].reshape(count, n, k), parameters[:, middle : middle + n]
        for views, view in zip((weights, biases), pair, strict=True):
            views.append(view if count > 1 else view[0])
    return weights, biases


def _read_only(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """A copy in float32."""
    array = _array(name, values)
    if array.shape not in (shape, (np.prod(shape),)):
        raise InputError(f"{name}: shape {array.shape}; expected {shape}")
    array = array.reshape(shape).copy()
    array.flags.writeable = False
    return array


def _fitted(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    array = _array(name, values)
    if array.shape != shape:  # one number for a matrix is rather a mistake than a wish
        raise InputError(f"{name}: shape {array.shape}; expected {shape}")
    return array


def _array(name: str, values: Any) -> np.ndarray:
    try:
        return np.asarray(values, np.float32)
    except (TypeError, ValueError):
        raise InputError(f"{name}: {type(values).__name__}; expected numbers") from None
