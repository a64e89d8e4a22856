"""What every command shares: the common options, devices, progress, `--json`, errors as one line and exit code 2."""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
import warp as wp
from tqdm import tqdm

from warp_neural.errors import InputError


@dataclass(frozen=True, kw_only=True)
class CommonConfig:
    """The options that every sample and command takes."""

    device: str = "auto"
    """auto (CUDA when present), cpu, cuda or cuda:N"""
    seed: int = 0
    """seed of every random draw; the same seed gives the same result on one device"""
    out: Path = Path("out")
    """folder for pictures and files"""
    json: bool = False
    """print nothing but one JSON object with the metrics, as the last line on stdout"""


def resolve_device(name: str) -> wp.Device:
    """`auto`, `cpu`, `cuda` or `cuda:N` to a Warp device. Raises `InputError` if it is not there."""
    if name == "auto":
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    try:
        return wp.get_device("cuda:0" if name == "cuda" else name)
    except Exception as error:
        there = ", ".join(device.alias for device in wp.get_devices())
        raise InputError(f"--device {name}: no such device; this machine has {there} (or use --device auto)") from error


def progress(iterable: Iterable, config: CommonConfig, **options: Any) -> tqdm:
    """A progress bar on stderr; silent with `--json` or without a terminal."""
    return tqdm(iterable, disable=True if config.json else None, file=sys.stderr, **options)


def run(main: Callable[[Any], dict], config_class: type, args: list[str] | None = None) -> dict:
    """Parse `config_class` from the command line, call `main(config)`, print its metrics.

    `InputError` becomes one line on stderr and exit code 2. With `--json` everything else that would reach stdout,
    native output too, goes to stderr.
    """
    wp.config.log_level = wp.LOG_WARNING  # no line for every module that is compiled or loaded
    config = tyro.cli(config_class, args=args)
    try:
        if not config.json:
            metrics = main(config)
            for key, value in metrics.items():
                print(f"{key:24} {value:.6g}" if isinstance(value, float) else f"{key:24} {value}")
        else:
            with _stdout_to_stderr():
                metrics = main(config)
            print(json.dumps(metrics))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    return metrics


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    sys.stdout.flush()
    saved = os.dup(1)
    os.dup2(2, 1)  # native code writes to the descriptor, Python to the object
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
