"""Warp Neural: neural shading as a Python package on NVIDIA Warp."""

import os
import signal
import sys
import tomllib
from importlib import import_module
from importlib.metadata import version
from pathlib import Path


def _stop(*_) -> None:
    """Until `cli.run`, Ctrl-C ends a command without a traceback."""
    os.write(2, b"stopped\n")
    os._exit(130)


if any(argument.endswith("warp-neural") or argument.startswith("warp_neural.") for argument in sys.orig_argv[1:3]):
    signal.signal(signal.SIGINT, _stop)

if hasattr(sys, "ps1") and sys.version_info < (3, 13) and "IPython" not in sys.modules:
    print(
        "Warp reads the source of functions, which this prompt does not keep: put your @wp.func and @wp.kernel into a "
        "file, or use IPython or Python 3.13",
        file=sys.stderr,
    )

_folder = Path(__file__).parent
if (_folder / "kernels").is_dir():
    __version__ = version("warp-neural")
else:  # a checkout, installed or not: `kernels` and `samples` lie beside this folder, and its version
    __path__.append(str(_folder.parent))
    __version__ = tomllib.loads((_folder.parent / "pyproject.toml").read_text("utf-8"))["project"]["version"]

from warp_neural import autodiff, coopvec
from warp_neural.config import config
from warp_neural.errors import InputError
from warp_neural.imaging.density import Density
from warp_neural.kernels.nn import activations, encodings, losses, random
from warp_neural.kernels.shading import sampling_2d
from warp_neural.nn import initialization
from warp_neural.nn.convert import load_rtxns, save_rtxns
from warp_neural.nn.mlp import MLP
from warp_neural.nn.network_file import load_network, save_network
from warp_neural.nn.sorting import sort_by_network
from warp_neural.nn.state import NetworkState
from warp_neural.train import optim
from warp_neural.train.trainer import Trainer

__all__ = [
    "MLP",
    "Density",
    "InputError",
    "NetworkState",
    "Trainer",
    "activations",
    "autodiff",
    "config",
    "coopvec",
    "encodings",
    "initialization",
    "load_network",
    "load_rtxns",
    "losses",
    "optim",
    "random",
    "render",
    "sampling_2d",
    "save_network",
    "save_rtxns",
    "sort_by_network",
    "texture",
]


def __getattr__(name: str):
    if name in ("render", "texture"):  # read much that the rest does without
        return import_module(f"warp_neural.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
