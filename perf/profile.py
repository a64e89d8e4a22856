"""What holds the kernels back that the goals name: `python -m perf.profile`, on CUDA only.

Of every kernel: registers a thread; bytes of stack, for spilled registers and arrays (a network's are of the path for
warps with missing lanes); bytes of shared memory a block; warps of a multiprocessor at once, of 64. The instructions
of its program by kind, each counted once, all paths together; that takes `cuobjdump`. By Nsight Compute, where `ncu`
is and may read counters: the time of a launch, percent of what tensor pipe (instructions begun, of which a `wgmma` is
one for 64 rows), issue slots, L1 with shared memory, L2 and DRAM can do, and bytes of DRAM a second.

Rows of `perf.inference` and `perf.training`: `network` with inputs made in the kernel, `memory` with float16 rows,
`train` with the kernels of a step of 2^18 samples.
"""

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from unittest import mock

import warp as wp

from perf import counters, networks, training
from perf.measure import Bench, Config
from perf.networks import SHAPES, make_net, shape_name
from perf.pictures import shares
from perf.results import Result
from perf.sass import find_tool, mix
from warp_neural.cli import progress, resolve_device, run
from warp_neural.errors import InputError
from warp_neural.kernels.coopvec.rows import make_evaluate_kernel

KINDS = [("float16", "float16"), ("float16", "float32"), ("e4m3", "float16"), ("int8", "float32")]
BLOCK, THREADS, BATCH = 64, 1 << 22, 1 << 18


@dataclass(frozen=True, kw_only=True)
class ProfileConfig(Config):
    launches: bool = False
    """launch every kernel once, for ncu, and write nothing"""


def recorded(step: Callable[[], None]) -> list[wp.Launch]:
    """The kernels that `step` launches, which it does."""
    commands, launch = [], wp.launch

    def record(*args, **options) -> None:
        commands.append(launch(*args, **options, record_cmd=True))
        commands[-1].launch()

    with mock.patch.object(wp, "launch", record):
        step()
    return commands


def network_launches(config: Config, device: wp.Device) -> dict[str, wp.Launch]:
    """As `perf.inference` launches them; bounds where there are 64 neurons."""
    found, y = {}, wp.zeros(THREADS, dtype=float, device=device)
    for precision, accumulation in KINDS:
        for depth, width in SHAPES:
            options = {"precision": precision, "accumulation": accumulation, "device": device}
            net = make_net(depth, width, seed=config.seed, **options)
            kernel = networks.make_shade_kernel(net, networks.bounds(BLOCK) if width == 64 else None)
            arguments = {"inputs": [net.params, 30, 0, y], "device": device, "block_dim": BLOCK}
            name = f"network {shape_name(depth, width)}, {precision}, {accumulation} sums"
            (found[name],) = recorded(lambda: wp.launch(kernel, THREADS, **arguments))  # noqa: B023
    return found


def memory_launches(config: Config, device: wp.Device) -> dict[str, wp.Launch]:
    found, n = {}, THREADS // 2
    for depth, width in [*SHAPES, (3, 16), (3, 128)]:
        net = make_net(depth, width, accumulation="float16", dtype=wp.float16, device=device, seed=config.seed)
        kernel = make_evaluate_kernel(net.of_row, net.vec_out)
        x = wp.array(networks.random_rows(n, width, config.seed), dtype=wp.float16, device=device)
        arguments = [net.params, x, wp.zeros((n, 16), dtype=wp.float16, device=device)]
        launch = lambda: wp.launch(kernel, n, arguments, device=device, block_dim=BLOCK)  # noqa: B023, E731
        (found[f"memory {shape_name(depth, width)}"],) = recorded(launch)
    return found


def named(name: str, step: Callable[[], None]) -> dict[str, wp.Launch]:
    """The kernels of `step`: `name` if it is one, else numbered, each with what it is called."""
    commands = recorded(step)
    if len(commands) == 1:
        return {name: commands[0]}
    return {f"{name}, {i + 1}: {c.kernel.key.split('__')[-1]}": c for i, c in enumerate(commands)}


def training_launches(config: Config, device: wp.Device) -> dict[str, wp.Launch]:
    found = {}
    for depth, width in training.SHAPES:
        sample, name = training.make_row_sample(width), f"train {shape_name(depth, width)}"
        trainer, _forward = training.row_trainer(config, device, depth, width, BATCH, sample)
        found |= named(f"{name}, gradient", lambda: trainer.launches.gradient(0))  # noqa: B023
        found |= named(f"{name}, update", trainer.launches.update)
    for name in ("frequency", "hash grid"):
        net = training.encoded_net(config, device, training.ENCODINGS[name])
        trainer = training.image_trainer(net, BATCH)
        found |= named(f"train {name}, gradient", lambda: trainer.launches.gradient(0))  # noqa: B023
        found |= named(f"train {name}, update", trainer.launches.update)
    return found


def add_static(bench: Bench, commands: dict[str, wp.Launch]) -> None:
    tool, settings = find_tool("cuobjdump"), bench.result.settings
    if tool is None:
        settings["instructions"] = "none, as cuobjdump is neither on PATH nor in /usr/local/cuda*/bin"
    for row, command in progress(commands.items(), bench.config):
        try:
            for column, value in counters.resources(command).items():
                bench.add(row, column, value, "B" if column in ("stack", "shared") else "")
            for column, value in (mix(tool, command) if tool else {}).items():
                bench.add(row, f"{column} instructions", value, "")
        except (OSError, RuntimeError, subprocess.CalledProcessError) as error:
            settings["not to be had"] = f"{row}: {error}"


def add_counted(bench: Bench, rows: list[str]) -> None:
    config = bench.config
    arguments = ["-m", "perf.profile", "--launches", "--device", bench.device.alias, "--seed", str(config.seed)]
    try:
        counted = counters.count(arguments, len(rows))
    except RuntimeError as error:
        bench.result.settings["counters"] = str(error)
        return
    for row, values in zip(rows, counted, strict=True):
        for column, value in values.items():
            bench.add(row, column, value, counters.COUNTERS[column][1])


def spoken(result: Result, name: str) -> str:
    """What `result` has of a kernel, or of each of its numbered kernels, in words; empty if nothing."""
    columns = ("registers", "stack", "warps", *(column for column in counters.COUNTERS if column != "time"))
    texts = []
    for row in dict.fromkeys(f.row for f in result.figures):
        if row == name or row.startswith(f"{name}, "):
            figures = [figure for column in columns if (figure := result.find(row, column))]
            words = ", ".join(f"{figure.column} {figure.text()} {figure.unit}".strip() for figure in figures)
            texts.append(f"*{row}*: {words}.")
    return " ".join(texts)


def main(config: ProfileConfig) -> dict:
    device = resolve_device(config.device)
    if not device.is_cuda:
        raise InputError(f"--device {config.device}: perf.profile looks at CUDA kernels; this machine runs the others")
    commands = {}
    for make in (network_launches, memory_launches, training_launches):
        commands |= make(config, device)
    if config.launches:
        wp.synchronize_device(device)
        with counters.marked():
            for command in commands.values():
                command.launch()
            wp.synchronize_device(device)
        return {"kernels": len(commands)}
    bench = Bench("profile", config, block=f"{BLOCK} of networks", threads=f"{THREADS:,}", batch=f"{BATCH:,}")
    bench.result.settings["rounds"] = "one launch each under ncu"
    add_static(bench, commands)
    add_counted(bench, list(commands))
    return bench.finish(shares)


if __name__ == "__main__":
    run(main, ProfileConfig)
