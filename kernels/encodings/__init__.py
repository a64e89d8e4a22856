"""Encodings: what stands between a network's inputs and its first layer. Each is a frozen dataclass; see `Encoding`."""

from kernels.encodings.base import Encoding
from kernels.encodings.concatenate import Concatenate
from kernels.encodings.frequency import Frequency, Identity, TriangleWave
from kernels.encodings.hash_grid import HashGrid
from kernels.encodings.latent_texture import LatentTexture
from kernels.encodings.one_blob import OneBlob
from kernels.encodings.spherical_harmonics import SphericalHarmonics

__all__ = [
    "Concatenate",
    "Encoding",
    "Frequency",
    "HashGrid",
    "Identity",
    "LatentTexture",
    "OneBlob",
    "SphericalHarmonics",
    "TriangleWave",
]
