"""Warp Neural: neural shading as a Python package on NVIDIA Warp."""

from pathlib import Path

_folder = Path(__file__).parent
if not (_folder / "kernels").is_dir():  # a checkout, where `kernels` and `samples` lie beside this folder
    __path__.append(str(_folder.parent))

from warp_neural import autodiff, coopvec
from warp_neural.errors import InputError
from warp_neural.imaging.density import Density
from warp_neural.kernels.nn import activations, encodings, losses
from warp_neural.kernels.shading import sampling_2d
from warp_neural.nn import initialization
from warp_neural.nn.convert import load_rtxns, save_rtxns
from warp_neural.nn.mlp import MLP
from warp_neural.nn.network_file import load_network, save_network
from warp_neural.nn.sorting import sort_by_network
from warp_neural.train import optim
from warp_neural.train.trainer import Trainer

__all__ = [
    "MLP",
    "Density",
    "InputError",
    "Trainer",
    "activations",
    "autodiff",
    "coopvec",
    "encodings",
    "initialization",
    "load_network",
    "load_rtxns",
    "losses",
    "optim",
    "sampling_2d",
    "save_network",
    "save_rtxns",
    "sort_by_network",
]
