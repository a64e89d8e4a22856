"""What several measurements run: kernels around a network, and its truth in float64."""

import numpy as np
import warp as wp

from warp_neural import MLP

SHAPES = [(2, 32), (3, 32), (2, 64), (3, 64)]  # hidden layers, neurons; as many inputs as neurons, 16 outputs
BOUNDED = 512  # threads that a multiprocessor must hold: 128 registers a thread, which suits 64 neurons
# Relative errors that each precision allows; the sums over 16 outputs, which partly cancel, are given four times that.
LIMITS = {"float32": 1e-5, "float16": 2e-3, "bfloat16": 1.5e-2, "e4m3": 0.15, "int8": 0.1}


def shape_name(depth: int, width: int) -> str:
    return f"{depth}x{width}"


def make_net(depth: int, width: int, *, seed: int, **options) -> MLP:
    """A ReLU network width -> width (`depth` times) -> 16 with random weights and biases, int8 calibrated."""
    net, rng = MLP(width, 16, width, depth, seed=seed, **options), np.random.default_rng(seed)
    net.biases = [rng.uniform(-0.1, 0.1, b.shape) for b in net.biases]
    if net.precision == "int8":
        net.calibrate(inputs_of(np.arange(0, 4096, 16), width))
    return net


def flops(net: MLP) -> int:
    """Of one evaluation, biases and activations not counted."""
    return 2 * sum(k * n for k, n in net.spec.layers)


def bounds(block: int) -> tuple[int, int]:
    return block, BOUNDED // block


@wp.func
def unit(i: int) -> float:
    return float(i % 4096) * wp.static(1.0 / 4096.0)


def inputs_of(i: np.ndarray, n_in: int) -> np.ndarray:
    """The inputs that thread i makes in the kernels below, [threads, n_in]."""
    return (i[:, None] % 4096 / 4096 * 2 / n_in * np.arange(n_in) - 0.5).astype(np.float32)


def random_rows(n: int, width: int, seed: int) -> np.ndarray:
    """float16 in [-1, 1), [n, width]; the first 65,536 rows again and again."""
    rows = np.random.default_rng(seed).uniform(-1, 1, (min(n, 1 << 16), width)).astype(np.float16)
    return np.resize(rows, (n, width))


def make_inputs(net: MLP) -> wp.Function:
    n_in, vec_in = net.n_in, net.vec_in
    element = net.spec.dtype

    @wp.func
    def inputs(i: int) -> vec_in:
        u = unit(i)
        x = vec_in()
        for k in range(wp.static(n_in)):
            x[k] = element(u * wp.static(2.0 / n_in) * float(k) - 0.5)
        return x

    return inputs


def make_total(net: MLP) -> wp.Function:
    vec_out, n_out = net.vec_out, net.n_out

    @wp.func
    def total(y: vec_out) -> float:
        result = float(0.0)
        for n in range(wp.static(n_out)):
            result += float(y[n])
        return result

    return total


def make_shade_kernel(net: MLP, launch_bounds: tuple[int, int] | None = None, skip_last_lane: bool = False):
    """Inputs from the thread index, the sum of the outputs to memory; thread i has network (i >> shift) & mask."""
    func, inputs, total = net.func, make_inputs(net), make_total(net)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=launch_bounds)
    def shade_kernel(params: net.Params, shift: int, mask: int, y: wp.array[float]):
        i = wp.tid()
        if wp.static(skip_last_lane):
            if i % 32 == 31:
                return
        y[i] = total(func(net.select(params, (i >> shift) & mask), inputs(i)))

    return shade_kernel


def make_ordered_kernel(net: MLP, launch_bounds: tuple[int, int] | None = None):
    """As above; thread i takes the place of order[i], whose network is network[order[i]]."""
    func, inputs, total = net.func, make_inputs(net), make_total(net)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=launch_bounds)
    def ordered_kernel(params: net.Params, order: wp.array[int], network: wp.array[int], y: wp.array[float]):
        i = order[wp.tid()]
        y[i] = total(func(net.select(params, network[i]), inputs(i)))

    return ordered_kernel


def layers_of(net: MLP, network: np.ndarray | int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights and biases (of several networks: of those of each sample) in float64; float16 weights as they round."""
    layers = []
    for w, b in zip(net.weights, net.biases, strict=True):
        if net.count > 1:
            w, b = w[network], b[network]
        w = w.astype(np.float16) if net.precision == "float16" else w
        layers.append((w.astype(np.float64), b.astype(np.float64)))
    return layers


def truth(net: MLP, x: np.ndarray, network: np.ndarray | int = 0) -> np.ndarray:
    """The ReLU network (of several: network[i]) in float64, [samples, n_out]."""
    result, layers = x.astype(np.float64), layers_of(net, network)
    for i, (w, b) in enumerate(layers):
        result = (np.einsum("snk,sk->sn", w, result) if net.count > 1 else result @ w.T) + b
        if i < len(layers) - 1:
            result = np.maximum(result, 0.0)
    return result


def true_gradient(net: MLP, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Of the mean of squares of the ReLU network at (encoded) inputs x, float64, in the order of `net.master`."""
    layers, kept = layers_of(net), [x.astype(np.float64)]
    for i, (w, b) in enumerate(layers):
        z = kept[-1] @ w.T + b
        kept.append(np.maximum(z, 0) if i < len(layers) - 1 else z)
    d, parts = 2 * (kept[-1] - target) / target.size, []
    for i, (w, _) in reversed(list(enumerate(layers))):
        parts.insert(0, np.concatenate([(d.T @ kept[i]).ravel(), d.sum(0)]))
        d = d @ w * (kept[i] > 0)
    return np.concatenate(parts)
