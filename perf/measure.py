"""What every measurement shares: its options, timing, checks before timing, and what it prints and writes."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import warp as wp

from perf import machine
from perf.results import FOLDER, Figure, Result
from warp_neural.cli import Between, CommonConfig, resolve_device
from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path

NOT_KEPT = Path("out/perf")
WARM_UP = 3  # rounds that do not count
ROUND_MS = 5  # what a round of several launches takes, about
MOST_MS = 3000  # of all rounds; where a launch takes long, there are fewer


@dataclass(frozen=True, kw_only=True)
class Config(CommonConfig):
    out: Path | None = None
    """folder for the JSON and the picture; none: out/perf/MACHINE"""
    record: bool = False
    """replace what the repository keeps of this machine, perf/results/MACHINE"""
    rounds: Annotated[int, Between(1, 10000)] = 12
    """rounds that count; a round is as many launches as take some milliseconds"""
    quick: bool = False
    """fewer shapes and precisions"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.record and (self.quick or self.out):
            raise InputError("--record: keeps whole measurements in perf/results; leave --quick and --out out")


def times(launch: Callable[[], None], device: wp.Device, rounds: int) -> np.ndarray:
    """Milliseconds of one `launch` in each round, [rounds]; on CUDA a round is a graph, timed by events."""
    with wp.ScopedDevice(device):
        launch()  # compiles
        wp.synchronize_device(device)
        once = wall_ms(launch, 1)
        repeat, rounds = int(np.clip(ROUND_MS // once, 1, 64)), int(np.clip(MOST_MS / once, min(3, rounds), rounds))
        if not device.is_cuda:
            return np.array([wall_ms(launch, repeat) for _ in range(WARM_UP + rounds)][WARM_UP:])
        with wp.ScopedCapture() as capture:
            for _ in range(repeat):
                launch()
        events = []
        for _ in range(WARM_UP + rounds):
            begin, end = wp.Event(enable_timing=True), wp.Event(enable_timing=True)
            wp.record_event(begin)
            wp.capture_launch(capture.graph)
            wp.record_event(end)
            events.append((begin, end))
        wp.synchronize_device(device)
        return np.array([wp.get_event_elapsed_time(*pair) / repeat for pair in events[WARM_UP:]])


def wall_ms(launch: Callable[[], None], repeat: int) -> float:
    begin = time.perf_counter()
    for _ in range(repeat):
        launch()
    wp.synchronize()
    return (time.perf_counter() - begin) * 1e3 / repeat


def times_in_turn(launches: dict[str, Callable[[], None]], rounds: int) -> dict[str, np.ndarray]:
    """Milliseconds on the CPU, [rounds] of each, taken in turn so that a busy machine is busy for all."""
    for launch in launches.values():
        launch()
    repeat = {name: int(np.clip(4 * ROUND_MS // wall_ms(launch, 1), 1, 64)) for name, launch in launches.items()}
    rows = [[wall_ms(launch, repeat[name]) for name, launch in launches.items()] for _ in range(WARM_UP + rounds)]
    return dict(zip(launches, np.array(rows[WARM_UP:]).T, strict=True))


def percent(share: float) -> str:
    return f"{100 * share:.0f}%" if share > 0.1 else f"{100 * share:.1f}%"


def check(name: str, result: np.ndarray, expected: np.ndarray, limit: float) -> None:
    """Stops a measurement of something that computes the wrong thing; the error is relative, of the whole array."""
    error = np.linalg.norm(result - expected) / max(np.linalg.norm(expected), 1e-30)
    if not error <= limit:
        raise RuntimeError(f"{name}: relative error {error:.1e} is above {limit:.1e}; nothing was timed")


class Bench:
    """Collects the figures of one measurement; `finish` prints and writes them."""

    def __init__(self, name: str, config: Config, **settings: object):
        self.config, self.device = config, resolve_device(config.device)
        texts = {key.replace("_", " "): str(value) for key, value in settings.items()}
        texts |= {"rounds": f"{config.rounds} after {WARM_UP}, medians, ± half of what 80 % of them span"}
        self.result = Result(name, {}, texts)

    def add(self, row: str, column: str, values: np.ndarray | float, unit: str, note: str = "") -> float:
        """Returns the median."""
        low, median, high = (float(v) for v in np.percentile(values, (10, 50, 90)))
        self.result.figures.append(Figure(row, column, median, low, high, unit, note))
        return median

    def recorded(self, row: str, column: str, value: float, unit: str) -> None:
        self.result.figures.append(Figure(row, column, value, value, value, unit, recorded=True))

    def time(self, row: str, column: str, launch: Callable[[], None], note: str = "") -> float:
        return self.add(row, column, times(launch, self.device, self.config.rounds), "ms", note)

    @property
    def speed_unit(self) -> str:
        return "TFLOP/s" if self.device.is_cuda else "GFLOP/s"

    def speed(
        self, row: str, column: str, launch: Callable[[], None], flops: float, *, launches: int = 1, **share: float
    ) -> float:
        """`flops` of each of `launches` that `launch` makes; with `peak=1000`, or another name, the share is noted."""
        return self.speed_of(row, column, times(launch, self.device, self.config.rounds), flops * launches, **share)

    def speed_of(self, row: str, column: str, ms: np.ndarray, flops: float, **share: float) -> float:
        values = flops / ms / (1e9 if self.device.is_cuda else 1e6)
        note = " ".join(f"({percent(np.median(values) / of)} of {name})" for name, of in share.items() if of)
        return self.add(row, column, values, self.speed_unit, note)

    def finish(self, draw: Callable[[Result], object]) -> dict:
        """Print the table, write NAME.json and NAME.png (`draw` gives a matplotlib figure); returns the metrics."""
        result, config = self.result, self.config
        result.machine = machine.facts(self.device)
        print(f"\n{result.measurement}: {result.notes()}\n\n{result.table()}\n")
        folder = config.out or (FOLDER if config.record else NOT_KEPT) / machine.slug(machine.name_of(self.device))
        path = result.save(folder)
        with atomic_path(path.with_suffix(".png")) as temporary:
            draw(result).savefig(temporary, dpi=90, bbox_inches="tight")
        return result.metrics() if config.json else {"results": str(path)}
