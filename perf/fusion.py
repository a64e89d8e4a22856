"""The lesson of layer fusion: `python -m perf.fusion`; one float16 network, 3x64 (CPU and --quick: 2x32), five ways.

`fused`: `wn.MLP`, whose vectors stay in fragments between layers. `single operations`: one `wn.coopvec` product a
layer, ReLU on whole vectors. `elementwise loops`: ReLU element by element. `element loads of the bias`: added in a loop
that reads it element by element. `separate bias`: read as a vector and added in an operation of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import numpy as np
import warp as wp

from perf import networks
from perf.measure import Bench, Config, check
from perf.networks import LIMITS, flops, inputs_of, make_inputs, make_net, make_total, truth
from perf.pictures import bars
from warp_neural import MLP
from warp_neural.cli import progress, run
from warp_neural.coopvec import Buffer, MatrixSpec, make_load, make_matmul, make_matmul_add, pack_matrix

BLOCK = 64


@wp.struct
class Stored:
    """The network for single operations; biases as float16 rows too, one a layer."""

    matrices: Buffer
    biases: Buffer
    rows: wp.array2d[wp.float16]


@dataclass(frozen=True)
class Layer:
    """spec of its product; index; offsets in bytes; whether ReLU follows."""

    spec: MatrixSpec
    index: int
    matrix: int
    bias: int
    relu: bool


def store(net: MLP, layout: str) -> tuple[Stored, list[Layer]]:
    """The weights of a float16 network in `layout`, each at a multiple of 64 bytes."""
    stored, words, biases, layers = Stored(), [np.zeros(0, np.uint32)], [], []
    rows = np.zeros((len(net.weights), 64), np.float16)
    for i, (w, b) in enumerate(zip(net.weights, net.biases, strict=True)):
        spec = MatrixSpec(*w.shape, net.precision, layout, dtype=wp.float16, accumulation="float16", bias="float16")
        layers.append(Layer(spec, i, 4 * sum(map(len, words)), rows[0].nbytes * i, i < len(net.weights) - 1))
        packed = pack_matrix(w, "float16", layout)
        words.append(np.pad(packed, (0, -len(packed) % 16)))
        rows[i, : len(b)] = b
        biases.append(rows[i].view(np.uint32))
    stored.matrices, stored.biases = Buffer(), Buffer()
    stored.matrices.data = wp.array(np.concatenate(words), dtype=wp.uint32, device=net.device)
    stored.biases.data = wp.array(np.concatenate(biases), dtype=wp.uint32, device=net.device)
    for buffer in (stored.matrices, stored.biases):
        buffer.gradient = wp.empty(0, dtype=float, device=net.device)
    stored.rows = wp.array(rows, dtype=wp.float16, device=net.device)
    return stored, layers


def vector_relu(layer: Layer) -> wp.Function:
    vec = layer.spec.vec_out

    @wp.func
    def relu(x: vec, stored: Stored) -> vec:
        return wp.max(x, vec())

    return relu


def loop_relu(layer: Layer) -> wp.Function:
    vec, n = layer.spec.vec_out, layer.spec.rows

    @wp.func
    def relu(x: vec, stored: Stored) -> vec:
        y = vec()
        for i in range(wp.static(n)):
            y[i] = wp.max(x[i], wp.float16(0.0))
        return y

    return relu


def with_bias(layer: Layer) -> wp.Function:
    """W x + b in one operation."""
    matmul_add, vec, matrix, bias = make_matmul_add(layer.spec), layer.spec.vec_in, layer.matrix, layer.bias

    @wp.func
    def product(x: vec, stored: Stored):
        return matmul_add(x, stored.matrices, wp.static(matrix), 0, stored.biases, wp.static(bias))

    return product


def bias_by_element(layer: Layer) -> wp.Function:
    matmul, vec, matrix, index, n = (
        make_matmul(layer.spec), layer.spec.vec_in, layer.matrix, layer.index, layer.spec.rows
    )  # fmt: skip

    @wp.func
    def product(x: vec, stored: Stored):
        y = matmul(x, stored.matrices, wp.static(matrix), 0)
        for i in range(wp.static(n)):
            y[i] += stored.rows[wp.static(index), i]
        return y

    return product


def bias_as_vector(layer: Layer) -> wp.Function:
    matmul, vec, matrix, index = make_matmul(layer.spec), layer.spec.vec_in, layer.matrix, layer.index
    load = make_load(layer.spec.rows, wp.float16)

    @wp.func
    def product(x: vec, stored: Stored):
        return matmul(x, stored.matrices, wp.static(matrix), 0) + load(stored.rows, wp.static(index))

    return product


def then(first: wp.Function, second: wp.Function) -> wp.Function:
    vec = first.input_types["x"]

    @wp.func
    def both(x: vec, stored: Stored):
        return second(first(x, stored), stored)

    return both


def chain(layers: list[Layer], product: Callable, relu: Callable) -> wp.Function:
    """The whole network of single operations, `(x, stored) -> vector of 16`."""
    functions = []
    for layer in layers:
        functions += [product(layer), relu(layer)] if layer.relu else [product(layer)]
    return reduce(then, functions)


def make_chain_kernel(net: MLP, layers: list[Layer], product: Callable = with_bias, relu: Callable = vector_relu):
    """As `networks.make_shade_kernel`."""
    func, inputs, total = chain(layers, product, relu), make_inputs(net), make_total(net)

    @wp.kernel(module="unique", enable_backward=False)
    def chain_kernel(stored: Stored, y: wp.array[float]):
        i = wp.tid()
        y[i] = total(func(inputs(i), stored))

    return chain_kernel


def chain_network(config: Config, device: wp.Device) -> tuple[MLP, int]:
    """What `fusion` and `layout` run, and how many threads."""
    shape = (2, 32) if config.quick or device.is_cpu else (3, 64)
    net = make_net(*shape, seed=config.seed, accumulation="float16", dtype=wp.float16, device=device)
    return net, 1 << 20 if device.is_cuda else 1 << 11


def measure(bench: Bench, row: str, kernel: wp.Kernel, first, net: MLP, n: int, **share: float) -> float:
    """`first`: what the kernel takes before the array of results; returns the median speed."""
    y = wp.zeros(n, dtype=float, device=bench.device)
    launch = lambda: wp.launch(kernel, n, [*first, y], device=bench.device, block_dim=BLOCK)  # noqa: E731
    launch()
    expected = truth(net, inputs_of(np.arange(min(n, 4096)), net.n_in)).sum(1)
    check(row, y.numpy()[:4096], expected, 4 * LIMITS["float16"])
    return bench.speed(row, networks.shape_name(len(net.spec.layers) - 1, net.n_in), launch, n * flops(net), **share)


def main(config: Config) -> dict:
    bench = Bench("fusion", config, precision="float16, float16 sums", block=BLOCK)
    net, n = chain_network(config, bench.device)
    bench.result.settings["threads"] = f"{n:,}"
    stored, layers = store(net, "inferencing_optimal")
    fused = measure(bench, "fused", networks.make_shade_kernel(net), [net.params, 30, 0], net, n)
    ways = {
        "single operations": (with_bias, vector_relu),
        "elementwise loops": (with_bias, loop_relu),
        "element loads of the bias": (bias_by_element, vector_relu),
        "separate bias": (bias_as_vector, vector_relu),
    }
    for row, way in progress(ways.items(), config):
        measure(bench, row, make_chain_kernel(net, layers, *way), [stored], net, n, fused=fused)
    return bench.finish(lambda result: bars(result, "Layer fusion", bench.speed_unit))


if __name__ == "__main__":
    run(main, Config)
