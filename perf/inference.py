"""Inference speed of networks: `python -m perf.inference [--device cuda]`.

LxN: L hidden layers of N neurons, N inputs, 16 outputs, ReLU, random weights. The rows by precision make their inputs
in the kernel and sum their outputs; on CUDA they give the better of no launch bounds and `networks.BOUNDED` where there
are 64 neurons. `peak` is what the same instructions do alone. `memory` reads and writes float16 rows; its floor is a
copy of as many bytes. `block` and `batch`: threads of a block and of a launch, of the fastest precision. `per thread`
and `tiled` are the other implementations; on CUDA Warp takes a minute to compile each shape of a tiled product, so that
only one is there. On CUDA other libraries that are installed take the rows of `memory` too (`perf.peers_cuda`). All are
compared with float64 before they are timed.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import warp as wp

from perf import networks, peers_cuda, recorded
from perf.measure import Bench, Config, check
from perf.networks import LIMITS, SHAPES, flops, make_net, make_shade_kernel, random_rows, shape_name, truth
from perf.peak import measure_cpu, measure_mma, measure_torch
from perf.pictures import bars
from warp_neural import MLP
from warp_neural.cli import Between, progress, run
from warp_neural.nn.evaluation import launch_rows

KINDS = [
    ("float16", "float16"),
    ("float16", "float32"),
    ("bfloat16", "float32"),
    ("e4m3", "float16"),
    ("int8", "float32"),
    ("float32", "float32"),
]
TILED = (3, 16)  # all its layers have one shape


@dataclass(frozen=True, kw_only=True)
class InferenceConfig(Config):
    samples: Annotated[int, Between(0, 2**28)] = 0
    """threads a launch; 0: 2^22 on CUDA, 2^14 on the CPU"""
    block: Annotated[int, Between(32, 1024)] = 64
    """threads a block"""


def measure_shade(bench: Bench, row: str, column: str, net: MLP, n: int, block: int, peak: float = 0.0) -> None:
    """The faster of the kernels with and without launch bounds, where there are 64 neurons."""
    device, width = bench.device, net.n_in
    expected = truth(net, networks.inputs_of(np.arange(min(n, 4096)), width)).sum(1)
    y = wp.zeros(n, dtype=float, device=device)
    bounded = device.is_cuda and width == 64 and net.implementation == "cooperative"
    kernels = [make_shade_kernel(net)] + ([make_shade_kernel(net, networks.bounds(block))] if bounded else [])
    for kernel in kernels:
        launch = lambda: wp.launch(kernel, n, [net.params, 30, 0, y], device=device, block_dim=block)  # noqa: B023, E731
        launch()
        check(f"{row} {column}", y.numpy()[:4096], expected, 4 * LIMITS[net.precision])
        bench.speed(row, column, launch, n * flops(net), peak=peak)
    if bounded:
        figures = bench.result.figures
        figures[-2:] = [max(figures[-2:], key=lambda figure: figure.value)]


def measure_kinds(bench: Bench, shapes: list, n: int) -> None:
    config, device = bench.config, bench.device
    kinds = [KINDS[0], KINDS[-1]] if config.quick else KINDS
    peaks = measure_mma(bench, kinds) if device.is_cuda else dict.fromkeys(kinds, measure_cpu(bench))
    measure_torch(bench)
    for precision, accumulation in progress(kinds, config, desc="precisions"):
        row = f"{precision}, {accumulation} sums"
        for shape in shapes:
            options = {"precision": precision, "accumulation": accumulation, "device": device}
            net = make_net(*shape, seed=config.seed, **options)
            peak = peaks.get((precision, accumulation), 0.0)
            measure_shade(bench, row, shape_name(*shape), net, n, config.block, peak)


def measure_others(bench: Bench, shapes: list, n: int) -> None:
    others = [("per_thread", "float32")] + ([] if bench.config.quick else [("tiled", "float16")])  # slow to compile
    for implementation, precision in others:
        for shape in [TILED] if implementation == "tiled" and bench.device.is_cuda else shapes:
            options = {"implementation": implementation, "precision": precision, "device": bench.device}
            net = make_net(*shape, seed=bench.config.seed, **options)
            row = f"{implementation.replace('_', ' ')}, {precision}"
            measure_shade(bench, row, shape_name(*shape), net, n, bench.config.block)
    if bench.device.is_cuda:
        net = make_net(*TILED, seed=bench.config.seed, device=bench.device)
        measure_shade(bench, "float16, float32 sums", shape_name(*TILED), net, n, bench.config.block)


def measure_memory(bench: Bench, shapes: list, n: int) -> None:
    config, device = bench.config, bench.device
    for depth, width in shapes:
        net = make_net(depth, width, accumulation="float16", dtype=wp.float16, device=device, seed=config.seed)
        x = random_rows(n, width, config.seed)
        inputs = wp.array(x, dtype=wp.float16, device=device)
        y = wp.zeros((n, 16), dtype=wp.float16, device=device)
        launch = lambda: launch_rows(net, net.plain, inputs, y)  # noqa: B023, E731
        launch()
        name = shape_name(depth, width)
        check(f"memory {name}", y.numpy()[:4096], truth(net, x[:4096]), LIMITS["float16"])
        bench.time("memory, float16", name, launch)
        half = [wp.zeros(n * (width + 16), dtype=wp.uint8, device=device) for _ in range(2)]  # half of all bytes
        bench.time("memory, floor", name, lambda: wp.copy(*half))  # noqa: B023
        if device.is_cuda and (depth, width) in SHAPES and not config.quick:
            peers_cuda.measure_inference(bench, net, x)
        if device.is_cuda and config.samples == 0:
            bench.recorded("memory, tiny-cuda-nn", name, recorded.TINY_CUDA_NN_INFERENCE[depth, width], "ms")


def measure_sizes(bench: Bench, n: int) -> None:
    """Blocks and launches of several sizes."""
    config, cuda = bench.config, bench.device.is_cuda
    for shape in (SHAPES[0], SHAPES[-1]):
        net = make_net(*shape, accumulation="float16", device=bench.device, seed=config.seed)
        for block in (32, 64, 128, 256) if cuda else ():
            measure_shade(bench, f"block {block}", shape_name(*shape), net, n, block)
        for bits in range(12, 23, 2) if cuda else (6, 10, 14):
            if 1 << bits <= n:
                measure_shade(bench, f"batch {1 << bits:,}", shape_name(*shape), net, 1 << bits, config.block)


def main(config: InferenceConfig) -> dict:
    bench = Bench("inference", config, block=config.block)
    cuda = bench.device.is_cuda
    n = config.samples or (1 << 22 if cuda else 1 << 14)
    bench.result.settings["threads"] = f"{n:,}"
    shapes, corners = ([SHAPES[0]] if config.quick else SHAPES), (SHAPES[:1] if config.quick else SHAPES[::3])
    measure_kinds(bench, shapes, n)
    measure_others(bench, corners, n if cuda else max(n // 8, 64))
    if cuda and not config.samples:
        for shape, value in recorded.DRIVER.items():
            bench.recorded("Vulkan driver, float16", shape_name(*shape), value, "TFLOP/s")
    measure_memory(bench, shapes if config.quick else [*shapes, (3, 16), (3, 128)], n // 2)
    if not config.quick:
        measure_sizes(bench, n)
    return bench.finish(lambda result: bars(result, "Inference", bench.speed_unit))


if __name__ == "__main__":
    run(main, InferenceConfig)
