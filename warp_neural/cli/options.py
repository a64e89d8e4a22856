"""The options that commands share, the ranges of numbers, and devices by name."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import warp as wp

from warp_neural.errors import InputError


@dataclass(frozen=True)
class Between:
    """Of numbers in an annotation, as in `Annotated[int, Between(1, 9)]`; of several, each is meant."""

    low: float
    high: float
    above: bool = False
    """`low` itself is too low"""
    multiple: int = 1
    """of this"""

    def __contains__(self, value: Any) -> bool:
        return all(map(self.has, value)) if isinstance(value, tuple) else self.has(value)

    def has(self, number: float) -> bool:
        above = self.low < number if self.above else self.low <= number
        return above and number <= self.high and (self.multiple == 1 or number % self.multiple == 0)

    def __str__(self) -> str:
        if self.multiple > 1:
            return f"a multiple of {self.multiple} to {self.high}"
        return f"a number above {self.low}, at most {self.high:g}" if self.above else f"{self.low} to {self.high}"


Count = Annotated[int, Between(1, 10**7)]  # tables of learning rates are as long
Samples = Annotated[int, Between(1, 2**26)]
Positive = Annotated[float, Between(0, 1e6, above=True)]
Side = Annotated[int, Between(1, 4096)]  # pixels
FOLDER = "checkpoints"  # beside what a command makes, while it runs and after it was stopped
Seed = Annotated[int, Between(0, 2**62 - 1)]  # of 64 bits; the mip maps draw four streams of one


class Options:
    """Of a dataclass: numbers outside their `Between` raise `InputError`, naming the option and the range."""

    def __post_init__(self) -> None:
        hints = get_type_hints(type(self), include_extras=True)
        for field in fields(self):
            value = getattr(self, field.name)
            for allowed in _ranges(hints[field.name]):
                if value is not None and value not in allowed:
                    shown = " ".join(map(str, value)) if isinstance(value, tuple) else value
                    raise InputError(f"--{field.name.replace('_', '-')} {shown}: give {allowed}")


def _ranges(hint: Any) -> list[Between]:
    """Of `Annotated[int, Between(1, 9)]`, also `| None`."""
    own = [each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Between)]
    return own + [found for argument in get_args(hint) for found in _ranges(argument)]


@dataclass(frozen=True, kw_only=True)
class CommonConfig(Options):
    """The options that every sample and command takes."""

    device: str = "auto"
    """auto (CUDA when present), cpu, cuda or cuda:N"""
    seed: Seed = 0
    """seed of every random draw; the same seed gives the same result on one device"""
    out: Path = Path("out")
    """folder for pictures and files"""
    json: bool = False
    """print nothing but one JSON object with the metrics, as the last line on stdout"""


@dataclass(frozen=True, kw_only=True)
class TrainingConfig(CommonConfig):
    """Of commands that train networks, see `cli.train`."""

    resume: bool = False
    """go on from the checkpoints that a stopped run has left in --out"""

    @property
    def checkpoints(self) -> Path:
        return self.out / FOLDER


def resolve_device(name: str) -> wp.Device:
    """`auto`, `cpu`, `cuda` or `cuda:N` to a Warp device. Raises `InputError` if it is not there."""
    if name == "auto":
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    try:
        return wp.get_device("cuda:0" if name == "cuda" else name)
    except Exception as error:
        there = ", ".join(device.alias for device in wp.get_devices())
        raise InputError(f"--device {name}: no such device; this machine has {there} (or use --device auto)") from error
