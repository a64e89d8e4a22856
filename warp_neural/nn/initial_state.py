"""The state of a fresh network from the arguments of `MLP`."""

from collections.abc import Callable

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.errors import LARGEST, LARGEST_SEED, require_whole
from warp_neural.kernels.nn import activations, encodings
from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.encodings import Encoding
from warp_neural.kernels.nn.spec import MAX_LAYERS, MAX_SIZE, NetworkSpec, format_of
from warp_neural.nn.names import require_object
from warp_neural.nn.state import NetworkState, check_size


def initial_state(
    n_in: int,
    n_out: int,
    width: int,
    depth: int,
    encoding: Encoding | None,
    activation: Activation,
    output_activation: Activation,
    precision: str,
    accumulation: str,
    dtype: type,
    implementation: str,
    initialization: Callable,
    count: int,
    seed: int,
) -> NetworkState:
    """As `MLP`. Raises `InputError` naming the argument."""
    if encoding is not None:
        require_object("encoding", encoding, (Encoding,), encodings, "one of wn.encodings, or None")
    require_whole("n_in", n_in, 1, LARGEST if encoding else MAX_SIZE)
    require_whole("n_out", n_out, 1, MAX_SIZE)
    require_whole("width", width, 1, MAX_SIZE)
    require_whole("depth", depth, 0, MAX_LAYERS - 1)
    require_whole("seed", seed, 0, LARGEST_SEED)
    for name, value in (("activation", activation), ("output_activation", output_activation)):
        require_object(name, value, (Activation,), activations, "one of wn.activations, or an Activation of your own")
    n_in, n_out, width, depth = map(int, (n_in, n_out, width, depth))  # NumPy's whole numbers too
    dtype = wp.float32 if dtype is float else dtype
    sizes = (encoding.n_out(n_in) if encoding else n_in, *[width] * depth, n_out)
    spec = NetworkSpec(sizes, activation, output_activation, format_of(precision), accumulation, dtype)
    check_size(count, spec, encoding, n_in)
    count = int(count)
    rng = np.random.default_rng(seed)
    layers = [_initial_layer(rng, k, n, initialization) for k, n in spec.layers * count]
    own = rng.uniform(*encoding.initial, count * encoding.n_parameters(n_in)) if encoding else None
    return NetworkState(
        spec, np.hstack(layers), count, implementation, encoding=encoding, n_in=n_in, encoding_parameters=own
    )


def _initial_layer(rng: np.random.Generator, n_in: int, n_out: int, initialization: Callable) -> np.ndarray:
    try:
        weights = np.asarray(initialization(rng, n_out, n_in), np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"initialization: {error}; expected (rng, n_out, n_in) -> [n_out, n_in] numbers") from error
    if weights.shape != (n_out, n_in) or not np.isfinite(weights).all():
        here = f"shape {weights.shape}" if weights.shape != (n_out, n_in) else "numbers that are not finite"
        raise InputError(f"initialization: gave {here}; expected [n_out, n_in], here {(n_out, n_in)}, all finite")
    return np.hstack([weights.ravel(), np.zeros(n_out)])
