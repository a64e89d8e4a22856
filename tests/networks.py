"""Run a network of any implementation over samples, forward and back, for comparison with `reference.py`."""

from functools import cache
from typing import NamedTuple

import numpy as np
import reference_networks as reference
import warp as wp

from warp_neural import MLP
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters, select_network
from warp_neural.nn.functions import FACTORIES
from warp_neural.nn.state import layers_of

BLOCK = 32  # samples come in whole blocks of one network each, as the tiled version needs


# Largest relative error of rounding to nearest. int8: half a step of max / 127, where the largest of a vector is about
# four times the root of its mean square.
ROUNDING = {
    "tf32": 2**-11, "float16": 2**-11, "bfloat16": 2**-8, "e4m3": 2**-4, "e5m2": 2**-3, "int8": 4 / 254,
}  # fmt: skip


class Results(NamedTuple):
    y: np.ndarray
    dw: list[np.ndarray]
    db: list[np.ndarray]
    dx: np.ndarray


@cache
def make_kernel(spec: NetworkSpec, implementation: str) -> wp.Kernel:
    """One module for all networks of a spec; without cuBLASDx, which takes minutes to compile."""
    func, vec_in, vec_out = FACTORIES[implementation](spec), spec.vec_in, spec.vec_out

    @wp.kernel(module="unique", module_options={"enable_mathdx_gemm": False})
    def network_kernel(params: Parameters, index: wp.array[int], x: wp.array[vec_in], y: wp.array[vec_out]):
        i = wp.tid()
        y[i] = func(select_network(params, index[i]), x[i])

    return network_kernel


def evaluate(net: MLP, x: np.ndarray, dy: np.ndarray | None = None, index: np.ndarray | None = None) -> Results:
    """Results `[n, n_out]` of network `index[i]` at `x[i]`, and gradients for the gradient `dy` of the results."""
    device = net.device
    index = np.zeros(len(x)) if index is None else index
    index = wp.array(index, dtype=int, device=device)
    inputs = wp.array(x, dtype=net.vec_in, device=device, requires_grad=True)
    y = wp.zeros(len(x), dtype=net.vec_out, device=device, requires_grad=True)
    net.gradient.zero_()
    with wp.Tape() as tape:
        arguments = [net.plain, index, inputs, y]
        wp.launch(make_kernel(net.spec, net.implementation), len(x), arguments, device=device, block_dim=BLOCK)
    if dy is not None:
        y.grad.assign(np.asarray(dy))
        tape.backward()
    return Results(y.numpy(), *gradients(net), inputs.grad.numpy())


def gradients(net: MLP) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Of weights and biases, as they are now."""
    return layers_of(net.spec, net.gradient.numpy()[: net.count * net.spec.n_parameters].copy())


def expected(net: MLP, x: np.ndarray, dy: np.ndarray) -> Results:
    """The same in float64, of a single network."""
    activations = [reference.ACTIVATIONS[net.spec.activation_of(i).name] for i in range(len(net.spec.layers))]
    return Results(*reference.mlp(net.weights, net.biases, activations, x, dy))


def random_biases(net: MLP, seed: int = 0) -> MLP:
    """Give the network biases, which start at zero; int8 is calibrated again."""
    rng = np.random.default_rng(seed)
    net.biases = [rng.uniform(-0.5, 0.5, b.shape) for b in net.biases]
    if net.precision == "int8":
        net.calibrate(samples(256, net.n_in, seed))
    return net


def samples(n: int, size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (n, size)).astype(np.float32)


def error(a: np.ndarray, b: np.ndarray) -> float:
    """Relative, of the whole array."""
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def flat(results):
    return [results.y, *results.dw, *results.db, results.dx]


def bound(net):
    """Each layer rounds its weights and its inputs, independently: the errors add in quadrature."""
    if net.precision == "float32" or net.implementation == "per_thread":
        return 1e-6
    return ROUNDING[net.precision] * np.sqrt(2 * len(net.spec.layers))
