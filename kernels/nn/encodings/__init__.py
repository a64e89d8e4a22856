"""Encodings: what stands between a network's inputs and its first layer. Each is a frozen dataclass; see `Encoding`."""

from warp_neural.kernels.nn.encodings.base import Encoding
from warp_neural.kernels.nn.encodings.concatenate import Concatenate
from warp_neural.kernels.nn.encodings.frequency import Frequency, Identity, TriangleWave
from warp_neural.kernels.nn.encodings.hash_grid import HashGrid
from warp_neural.kernels.nn.encodings.latent_texture import LatentTexture
from warp_neural.kernels.nn.encodings.one_blob import OneBlob
from warp_neural.kernels.nn.encodings.scaled import Scaled
from warp_neural.kernels.nn.encodings.spherical_harmonics import SphericalHarmonics

__all__ = [
    "Concatenate",
    "Encoding",
    "Frequency",
    "HashGrid",
    "Identity",
    "LatentTexture",
    "OneBlob",
    "Scaled",
    "SphericalHarmonics",
    "TriangleWave",
]
