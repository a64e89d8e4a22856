"""Warp Neural: neural shading as a Python package on NVIDIA Warp."""

import kernels

if not getattr(kernels, "__warp_neural__", False):
    raise ImportError(
        f"the package 'kernels' at {kernels.__file__} is not Warp Neural's; uninstall it "
        "(pip uninstall kernels) or use a fresh virtual environment"
    )

from kernels import activations, encodings, losses, sampling_2d
from warp_neural import autodiff, coopvec, optim
from warp_neural.convert import load_rtxns, save_rtxns
from warp_neural.density import Density
from warp_neural.errors import InputError
from warp_neural.network import MLP
from warp_neural.network_file import load_network, save_network
from warp_neural.sorting import sort_by_network
from warp_neural.trainer import Trainer

__all__ = [
    "MLP",
    "Density",
    "InputError",
    "Trainer",
    "activations",
    "autodiff",
    "coopvec",
    "encodings",
    "load_network",
    "load_rtxns",
    "losses",
    "optim",
    "sampling_2d",
    "save_network",
    "save_rtxns",
    "sort_by_network",
]
