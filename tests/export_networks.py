"""Networks of every activation and encoding, several of each, and what Python makes of random inputs."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import warp as wp

from warp_neural.kernels.nn import activations, encodings
from warp_neural.nn.mlp import MLP
from warp_neural.nn.state import NetworkState

ENCODINGS = {
    "Identity": (2, encodings.Identity()),
    "TriangleWave": (3, encodings.TriangleWave(5)),
    "Frequency": (2, encodings.Frequency(6, 1.5)),
    "OneBlob": (2, encodings.OneBlob(7)),
    "SphericalHarmonics": (3, encodings.SphericalHarmonics(5)),
    "LatentTexture": (2, encodings.LatentTexture(5, 7, 3)),
    "LatentTexture, wrap": (2, encodings.LatentTexture(4, 6, 2, wrap=True)),
    "Scaled": (3, encodings.Scaled(encodings.SphericalHarmonics(3), 2.0, -1.0)),
    "HashGrid": (3, encodings.HashGrid(4, 2, 8, 3, 1.7)),
    "Concatenate": (
        5,
        encodings.Concatenate(
            (encodings.Frequency(3), encodings.LatentTexture(4, 4, 2), encodings.SphericalHarmonics(3)),
            ((0, 1), (1, 3), (2, 3, 4)),
        ),
    ),
}
CASES = [(activation.name, precision) for activation in activations.ALL for precision in ("float32", "float16")]
CASES += [(name, "float32") for name in ENCODINGS]
OF_EACH = 3
ROWS = 48


@dataclass(frozen=True)
class Case:
    state: NetworkState
    inputs: np.ndarray
    outputs: np.ndarray


@cache
def cases(name: str, precision: str) -> list[Case]:
    """name: of an activation or an encoding."""
    rng, n_in, encoding = np.random.default_rng(len(name)), 3, None
    activation = getattr(activations, name, activations.elu)
    if name in ENCODINGS:
        n_in, encoding = ENCODINGS[name]
    output = activations.linear if activation in (activations.relu, activations.exponential) else activation
    options = {"activation": activation, "output_activation": output, "precision": precision, "encoding": encoding}
    net = MLP(n_in, 3, 18, 2, device="cpu", **options)
    return [_case(net, rng) for _ in range(OF_EACH)]


def _case(net: MLP, rng: np.random.Generator) -> Case:
    net.weights = [0.4 * rng.standard_normal(w.shape) for w in net.weights]
    net.biases = [0.2 * rng.standard_normal(b.shape) for b in net.biases]
    own = rng.uniform(-1, 1, net.state.encoding_parameters.shape)
    net = MLP.from_state(replace(net.state, encoding_parameters=own), device="cpu")
    inputs = rng.uniform(-1.5, 2.5, (ROWS, net.n_in)).astype(np.float32)
    inputs[0] = 0
    return Case(net.state, inputs, net.evaluate(wp.array(inputs, device="cpu")).numpy())
