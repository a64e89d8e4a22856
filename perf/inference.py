"""Inference speed of cooperative networks: `python -m perf.inference [--device cuda]`.

`kernel`: inputs made in the kernel, outputs summed, TFLOP/s by precision, accumulation and shape (LxN: L hidden layers
of N neurons, N inputs, 16 outputs). `memory`: float16 rows in and out, milliseconds. `distinct`: 3x64 float16, groups
of consecutive threads with a network of their own. Random weights; every kernel is compared with float64 before it is
timed; on CUDA, launches repeat in a graph; medians of 12 rounds after 3 of warm-up. `kernel` gives the better of no
launch bounds and `BOUNDED`, which leaves a thread 128 registers and suits 64 neurons; `distinct` has them.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_neural import MLP
from warp_neural.cli import CommonConfig, resolve_device, run
from warp_neural.coopvec import make_load, make_store

SHAPES = [(2, 32), (3, 32), (2, 64), (3, 64)]
KINDS = [
    ("float16", "float16"),
    ("float16", "float32"),
    ("bfloat16", "float32"),
    ("e4m3", "float16"),
    ("int8", "float32"),
]
# Relative errors that each precision allows; the sums over 16 outputs, which partly cancel, are given four times that.
LIMITS = {"float16": 2e-3, "bfloat16": 1.5e-2, "e4m3": 0.15, "int8": 0.1}


BOUNDED = 512  # threads that a multiprocessor must hold


@dataclass(frozen=True)
class Config(CommonConfig):
    samples: int = 0
    """threads a launch; 0: 2^22 on CUDA, 2^14 on the CPU"""
    block: int = 64
    """threads a block"""


def make_shade_kernel(net: MLP, bounds: tuple[int, int] | None = None):
    """Inputs from the thread index, the sum of the outputs to memory; thread i has network (i >> shift) & mask."""
    func, vec_in, n_in, n_out = net.func, net.vec_in, net.spec.sizes[0], net.spec.sizes[-1]

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=bounds)
    def shade_kernel(params: net.Params, shift: int, mask: int, y: wp.array[float]):
        i = wp.tid()
        u = float(i % 4096) * wp.static(1.0 / 4096.0)
        x = vec_in()
        for k in range(wp.static(n_in)):
            x[k] = u * wp.static(2.0 / n_in) * float(k) - 0.5
        result = func(net.select(params, (i >> shift) & mask), x)
        total = float(0.0)
        for n in range(wp.static(n_out)):
            total += result[n]
        y[i] = total

    return shade_kernel


def make_memory_kernel(net: MLP):
    """A row of inputs to a row of outputs a thread, float16."""
    func, load, store = net.func, make_load(net.spec.sizes[0], wp.float16), make_store(net.spec.sizes[-1], wp.float16)

    @wp.kernel(module="unique", enable_backward=False)
    def memory_kernel(params: net.Params, x: wp.array2d[wp.float16], y: wp.array2d[wp.float16]):
        i = wp.tid()
        store(y, i, func(params, load(x, i)))

    return memory_kernel


def truth(net: MLP, x: np.ndarray, network: np.ndarray) -> np.ndarray:
    """The ReLU network in float64, [samples, n_out]."""
    result = x.astype(np.float64)
    layers = list(zip(net.weights, net.biases, strict=True))
    for i, (weights, biases) in enumerate(layers):
        weights, biases = np.asarray(weights, np.float64), np.asarray(biases, np.float64)
        if net.count > 1:
            weights, biases = weights[network], biases[network]
            result = np.einsum("snk,sk->sn", weights, result) + biases
        else:
            result = result @ weights.T + biases
        if i < len(layers) - 1:
            result = np.maximum(result, 0.0)
    return result


def check(name: str, result: np.ndarray, expected: np.ndarray, limit: float) -> None:
    error = np.linalg.norm(result - expected) / np.linalg.norm(expected)
    if not error <= limit:
        raise RuntimeError(f"{name}: relative error {error:.1e} is above {limit:.1e}; nothing was timed")


def median_ms(launch, device: wp.Device, repeat: int) -> float:
    """Milliseconds of one launch: the median of 12 rounds of `repeat` launches, 3 rounds of warm-up before."""
    with wp.ScopedDevice(device):
        launch()
        rounds = launch
        if device.is_cuda:
            with wp.ScopedCapture() as capture:
                for _ in range(repeat):
                    launch()
            rounds = lambda: wp.capture_launch(capture.graph)  # noqa: E731
        times = []
        for _ in range(15):
            with wp.ScopedTimer("", print=False, synchronize=True) as timer:
                rounds()
            times.append(timer.elapsed / (repeat if device.is_cuda else 1))
        return float(np.median(times[3:]))


def tflops(net: MLP, n: int, ms: float) -> float:
    return 2 * sum(k * m for k, m in net.spec.layers) * n / ms / 1e9


def measure_kernel(config: Config, device: wp.Device, n: int) -> dict:
    metrics, i = {}, np.arange(4096)
    for precision, accumulation in KINDS:
        for depth, width in SHAPES:
            name = f"kernel_{precision}_{accumulation}_{depth}x{width}"
            kind = {"precision": precision, "accumulation": accumulation, "device": device, "seed": config.seed}
            net, y = MLP(width, 16, width, depth, **kind), wp.zeros(n, dtype=float, device=device)
            x = (i[:, None] / 4096 * 2 / width * np.arange(width) - 0.5).astype(np.float32)
            if precision == "int8":
                net.calibrate(x)
            expected, times = truth(net, x, i * 0).sum(1)[:n], []
            for bounds in (None, (config.block, BOUNDED // config.block)) if device.is_cuda else (None,):
                kernel = make_shade_kernel(net, bounds)
                launch = lambda: wp.launch(kernel, n, [net.params, 30, 0, y], device=device, block_dim=config.block)  # noqa: B023, E731
                launch()
                check(name, y.numpy()[:4096], expected, 4 * LIMITS[precision])
                times.append(median_ms(launch, device, max(1, (1 << 24) // n)))
            metrics[name] = tflops(net, n, min(times))
    return metrics


def measure_memory(config: Config, device: wp.Device, n: int) -> dict:
    metrics, rng = {}, np.random.default_rng(config.seed)
    for depth, width in [*SHAPES, (3, 16), (3, 128)]:
        kind = {"accumulation": "float16", "dtype": wp.float16, "device": device, "seed": config.seed}
        net = MLP(width, 16, width, depth, **kind)
        kernel = make_memory_kernel(net)
        x = rng.uniform(-1, 1, (n, width)).astype(np.float16)
        inputs = wp.array(x, dtype=wp.float16, device=device)
        y = wp.zeros((n, 16), dtype=wp.float16, device=device)
        launch = lambda: wp.launch(kernel, n, [net.params, inputs, y], device=device, block_dim=config.block)  # noqa: B023, E731
        launch()
        name = f"memory_{depth}x{width}_ms"
        check(name, y.numpy()[:4096], truth(net, x[:4096], 0), LIMITS["float16"])
        metrics[name] = median_ms(launch, device, 8)
    return metrics


def measure_distinct(config: Config, device: wp.Device) -> dict:
    """Groups of 2^shift threads; fewer inputs below 256 a network, so that there are at most 1,024 networks.

    512 launches on 32 streams, in one graph: they may overlap, as dispatches of one command buffer may.
    """
    metrics = {}
    streams = [wp.Stream(device) for _ in range(32)]
    for shift in (14, 10, 8, 6, 5, 4, 3, 2, 0):
        n = (1 << 18) >> max(0, 8 - shift)
        count = max(1, n >> shift)
        net = MLP(64, 16, 64, 3, accumulation="float16", count=count, device=device, seed=config.seed)
        kernel, y = make_shade_kernel(net, (64, BOUNDED // 64)), wp.zeros(n, dtype=float, device=device)
        arguments = [net.params, shift, count - 1, y]
        wp.launch(kernel, n, arguments, device=device, block_dim=64)
        some = np.arange(0, n, max(1, n // 512))
        x = (some[:, None] % 4096 / 4096 * 2 / 64 * np.arange(64) - 0.5).astype(np.float32)
        name = f"distinct_{1 << shift}"
        check(name, y.numpy()[some], truth(net, x, some >> shift).sum(1), 4 * LIMITS["float16"])

        def launch_all():
            begin = wp.record_event()
            for stream in streams:
                stream.wait_event(begin)
                for _ in range(16):
                    wp.launch(kernel, n, arguments, stream=stream, block_dim=64)  # noqa: B023
                wp.wait_event(stream.record_event())

        metrics[name] = tflops(net, 512 * n, median_ms(launch_all, device, 1))
    return metrics


def main(config: Config) -> dict:
    device = resolve_device(config.device)
    n = config.samples or (1 << 22 if device.is_cuda else 1 << 14)
    metrics = {"device": device.name, "warp": wp.__version__, "samples": n, "block": config.block, "rounds": 12}
    metrics |= measure_kernel(config, device, n) | measure_memory(config, device, n // 2)
    return metrics | (measure_distinct(config, device) if device.is_cuda else {})


if __name__ == "__main__":
    run(main, Config)
