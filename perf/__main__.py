"""All measurements that this machine can make: `python -m perf [--quick] [--record] [--device cuda]`.

Each runs in a process of its own and alone. On CUDA all run at once before that, one round each into a folder that goes
away: their kernels then lie compiled in Warp's cache, and the measurements take little but their own time. `cpu` and
`samples` are left out with `--device cuda`, `samples` and `profile` with `--quick`, `profile` without CUDA,
`texture_codecs` and `texture_storage` without `--material FOLDER`, `texture_torch` without PyTorch. Ends with
`python -m perf.report` if told to `--record`.
"""

import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from perf import report
from perf.measure import Config
from warp_neural.cli import resolve_device, run

NAMES = (
    "inference", "training", "divergence", "profile", "fusion", "layout", "precision", "compile", "mipmap", "cpu",
    "samples", "texture_torch", "texture_reading", "texture_codecs", "texture_storage",
)  # fmt: skip
OF_MATERIALS = ("texture_codecs", "texture_storage")
NOT_AHEAD = ("compile", "profile", "cpu", "samples", *OF_MATERIALS)  # have own caches, others' kernels, or run long
MOST_SECONDS = 300  # of one measurement
MOST_SECONDS_OF_CODECS = 7200  # FLIP takes seconds a map and setting, files minutes each on the CPU


@dataclass(frozen=True, kw_only=True)
class AllConfig(Config):
    material: Path | None = None
    """folder of a material for `texture_codecs` and `texture_storage`"""


def chosen(config: AllConfig, cuda: bool) -> list[str]:
    left_out = {"samples", "profile"} if config.quick else set()
    left_out |= set() if config.material else set(OF_MATERIALS)
    left_out |= set() if find_spec("torch") else {"texture_torch"}
    left_out |= set() if cuda else {"profile"}
    left_out |= {"cpu", "samples"} if cuda and config.device != "auto" else set()
    return [name for name in NAMES if name not in left_out]


def measure(name: str, options: list[str]) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", f"perf.{name}", *options]
    most = MOST_SECONDS_OF_CODECS if name in OF_MATERIALS else MOST_SECONDS
    try:
        return subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=most)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 1, stderr=f"it took more than {most} s")


def compile_ahead(names: list[str], options: list[str]) -> None:
    """Failures show again when it counts."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor() as pool:
        for name in names:
            command = [sys.executable, "-m", f"perf.{name}", *options, "--rounds", "1", "--out", folder]
            pool.submit(subprocess.run, command, capture_output=True, timeout=MOST_SECONDS)


def main(config: AllConfig) -> dict:
    device = resolve_device(config.device)
    names = chosen(config, device.is_cuda)
    options = ["--seed", str(config.seed)] + ["--quick"] * config.quick
    where = ["--device", device.alias]
    metrics, failed, begin = {}, [], time.perf_counter()
    if device.is_cuda:
        compile_ahead([name for name in names if name not in NOT_AHEAD], options + where)
        metrics["compile_ahead_seconds"] = time.perf_counter() - begin
    options += ["--rounds", str(config.rounds)] + (["--out", str(config.out)] if config.out else [])
    options += ["--record"] * config.record
    for name in names:
        start = time.perf_counter()
        material = ["--material", str(config.material)] if name in OF_MATERIALS else []
        done = measure(name, options + material + (["--device", "cpu"] if name == "cpu" else where))
        metrics[f"{name}_seconds"] = time.perf_counter() - start
        if done.returncode:
            failed.append(name)
            print(f"perf.{name} failed:\n{done.stderr}", file=sys.stderr)
    if config.record:
        report.main(report.Config(json=config.json))
    metrics |= {"seconds": time.perf_counter() - begin, "failed": ", ".join(failed) or "none"}
    if failed:
        print(metrics)
        raise SystemExit(1)
    return metrics


if __name__ == "__main__":
    run(main, AllConfig)
