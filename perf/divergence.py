"""Speed against threads that share a network: `python -m perf.divergence`, the lecture's picture.

The set-up of the Vulkan driver's directed test: 2^18 threads a launch, at most 1,024 networks, fewer threads in
proportion below 256 a network; on CUDA 256 launches on 32 streams in one graph, which may overlap as dispatches do.
From 2^18 threads a network on a launch has one network, so that 2^31 stands for all of those powers. `no last lane`:
the last lane of every warp has returned. `shuffled`: every thread has a random network of those; `sorted`: the same
threads after `wn.sort_by_network`, whose own time for 2^18 threads is the last row. Speeds count active threads.
On the CPU threads run one after the other: 2^11 of them, at most 256 networks, and only the cache sees the difference.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from perf import networks, recorded
from perf.measure import WARM_UP, Bench, Config, check, wall_ms
from perf.networks import LIMITS, SHAPES, flops, inputs_of, make_net, make_ordered_kernel, make_shade_kernel, truth
from perf.pictures import axes, line
from perf.results import Result
from warp_neural import MLP, sort_by_network
from warp_neural.cli import progress, run

KINDS = [("float16", "float16"), ("e4m3", "float16"), ("int8", "float32")]
BLOCK, STREAMS, LAUNCHES = 64, 32, 8  # threads, streams, launches of each


@dataclass(frozen=True)
class Sizes:
    """bits: of the threads of a launch. networks: the most. shifts: bits of the threads that share a network."""

    bits: int
    networks: int
    shifts: tuple[int, ...]

    def threads(self, shift: int) -> int:
        return min(1 << self.bits, self.networks << shift)


@cache
def make_nets(kind: tuple[str, str], shape: tuple[int, int], count: int, device: str, seed: int) -> MLP:
    """Kept, as a thousand networks take a second to make."""
    return make_net(*shape, count=count, precision=kind[0], accumulation=kind[1], device=device, seed=seed)


class Curve:
    """One line of the picture: launches of one kernel with growing groups."""

    def __init__(self, bench: Bench, sizes: Sizes, kind: tuple[str, str], shape: tuple[int, int], way: str = ""):
        self.bench, self.sizes, self.way = bench, sizes, way
        self.device = bench.device
        self.kind, self.shape, self.limit = kind, shape, 4 * LIMITS[kind[0]]
        self.column = ", ".join(filter(None, (f"{kind[0]} {networks.shape_name(*shape)}", way)))
        self.streams = [wp.Stream(self.device) for _ in range(STREAMS)] if self.device.is_cuda else []
        self.kernel = None

    def measure(self) -> None:
        bounds = networks.bounds(BLOCK) if self.device.is_cuda and self.shape[1] == 64 else None
        for shift in self.sizes.shifts:
            n = self.sizes.threads(shift)
            net = make_nets(self.kind, self.shape, max(1, n >> shift), self.device.alias, self.bench.config.seed)
            if self.kernel is None:
                if self.way in ("shuffled", "sorted"):
                    self.kernel = make_ordered_kernel(net, bounds)
                else:
                    self.kernel = make_shade_kernel(net, bounds, skip_last_lane=self.way == "no last lane")
            self.measure_one(net, shift, n)

    def measure_one(self, net: MLP, shift: int, n: int) -> None:
        y = wp.zeros(n, dtype=float, device=self.device)
        network, active = (np.arange(n) >> min(shift, 30)).astype(np.int32), np.arange(n)
        if self.way == "no last lane":
            active = active[active % 32 < 31]
        if self.way in ("shuffled", "sorted"):
            network = np.random.default_rng(shift).permutation(network)
            given = wp.array(network, dtype=int, device=self.device)
            order = wp.array(np.arange(n), dtype=int, device=self.device)
            arguments = [net.params, sort_by_network(given) if self.way == "sorted" else order, given, y]
        else:
            arguments = [net.params, min(shift, 30), net.count - 1, y]
        launch = lambda stream=None: wp.launch(  # noqa: E731
            self.kernel, n, arguments, device=self.device, block_dim=BLOCK, stream=stream
        )
        launch()
        some = active[:: max(1, n // 512)]
        expected = truth(net, inputs_of(some, net.n_in), network[some]).sum(1)
        check(f"{self.column}, {1 << shift} threads", y.numpy()[some], expected, self.limit)
        count = STREAMS * LAUNCHES if self.streams else 1
        work, row = len(active) * flops(net), f"{1 << shift:,}"
        self.bench.speed(row, self.column, self.overlapping(launch) if self.streams else launch, work, launches=count)

    def overlapping(self, launch: Callable) -> Callable[[], None]:
        def launch_all() -> None:
            begin = wp.record_event()
            for stream in self.streams:
                stream.wait_event(begin)
                for _ in range(LAUNCHES):
                    launch(stream)
                wp.wait_event(stream.record_event())

        return launch_all


def measure_sort(bench: Bench, n: int, column: str) -> None:
    """As a user calls it, memory allocated and all."""
    network = wp.array(np.random.default_rng(0).integers(0, 1024, n), dtype=int, device=bench.device)
    values = [wall_ms(lambda: sort_by_network(network), 1) for _ in range(WARM_UP + bench.config.rounds)]
    bench.add("sort_by_network", column, np.array(values[WARM_UP:]), "ms")


def draw(result: Result, unit: str):
    canvas, ax = axes(f"Threads that share a network\n{result.machine['device']}", unit, 11, 6)
    for i, column in enumerate(dict.fromkeys(f.column for f in result.figures if f.unit == unit)):
        measured = [f for f in result.rows(column) if not f.recorded and f.unit == unit]
        recorded = [f for f in result.rows(column) if f.recorded]
        style = {"marker": ".", "color": f"C{i % 10}", "linestyle": "-" if i < 10 else ":"}
        if recorded:
            style = {"marker": "x", "color": "black" if column.endswith("3x64") else "grey", "linestyle": "--"}
        line(ax, measured or recorded, column + (" (recorded)" if recorded else ""), **style)
    ax.set_xscale("log", base=2)
    ax.set_yscale("log")
    ax.set_xlabel("threads that share a network")
    ax.legend(fontsize=7, ncols=2)
    return canvas


def main(config: Config) -> dict:
    bench = Bench("divergence", config, block=BLOCK)
    if bench.device.is_cuda:
        sizes, shapes, kinds, ways = (
            Sizes(18, 1024, (*range(18), 31)),
            SHAPES,
            KINDS,
            ("no last lane", "shuffled", "sorted"),
        )
    else:
        sizes, shapes = Sizes(11, 256, (0, 1, 2, 3, 4, 6, 8, 10, 31)), SHAPES[::3]
        kinds, ways = KINDS[: 1 if config.quick else 3], ("shuffled", "sorted")
    if config.quick:
        sizes, shapes, kinds, ways = (
            Sizes(sizes.bits, sizes.networks, (0, 3, 6, 31)),
            SHAPES[:1],
            KINDS[:1],
            ("sorted",),
        )
    bench.result.settings["threads"] = f"{1 << sizes.bits:,}"
    curves = [Curve(bench, sizes, kind, shape) for kind in kinds for shape in shapes]
    curves += [Curve(bench, sizes, kinds[0], shapes[-1], way) for way in ways]
    for curve in progress(curves, config):
        curve.measure()
    measure_sort(bench, 1 << sizes.bits, curves[-1].column)
    if bench.device.is_cuda:
        for name, values in recorded.DRIVER_SHARED.items():
            for threads, value in values.items():
                bench.recorded(f"{threads:,}", f"Vulkan driver, float16 {name}", value, "TFLOP/s")
    return bench.finish(lambda result: draw(result, bench.speed_unit))


if __name__ == "__main__":
    run(main, Config)
