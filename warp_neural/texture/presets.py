"""Grids for few and for many bits, and how long to train."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log2, prod

import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import BlockSpec, Grid, TextureSpec

FEW = Grid(4, 24), Grid(8, 16, "separable"), Grid(16, 8, "bilinear")
MANY = Grid(2, 12), Grid(4, 16), Grid(8, 12, "separable"), Grid(16, 8, "bilinear")
MANY_FROM = 2.0  # bits a texel
QUALITIES = {"low": 1.5e-3, "medium": 3e-4, "high": 6e-5}
"""lambda: mean squared error that a bit a texel is worth"""
FIXED = {
    0.5: (Grid(8, 16, bits=1), Grid(16, 16, bits=4)),
    1.0625: (Grid(4, 8, bits=1), Grid(8, 16, bits=1), Grid(16, 20, bits=4)),
    1.625: (Grid(4, 12, bits=1), Grid(8, 32, bits=1), Grid(16, 24, bits=4)),
    2.5: (Grid(4, 24, bits=1), Grid(8, 12, bits=4), Grid(16, 16, bits=4)),
    3.75: (Grid(4, 24, bits=1), Grid(8, 32, bits=4), Grid(16, 16, bits=4)),
    5.0: (Grid(2, 4, bits=1), Grid(4, 32, bits=1), Grid(8, 28, bits=4), Grid(16, 16, bits=4)),
    6.4375: (Grid(2, 10, bits=1), Grid(4, 32, bits=1), Grid(8, 28, bits=4), Grid(16, 12, bits=4)),
    10.0: (Grid(2, 24, bits=1), Grid(4, 32, bits=1), Grid(8, 32, bits=4)),
}
"""by the bits of latents a texel in memory. Many latents of one bit where cells are small are 1.3 dB better than few of
four bits at 3.75 (PavingStones070, the best of three rates); those of 0.5, 2.5, 5 and 10 bits were not compared."""
FIXED_QUALITIES = {"low": 1.0625, "medium": 3.75, "high": 6.4375}
FIXED_RATE, FIXED_SPREAD = 1.0, 0.5  # of the optimizer, in steps; of latents at the start, of half of their range
BLOCKS = {2.5: (2, *[4] * 6), 5.0: (2,) * 5, 10.0: (1, *[2] * 6), 16.0: (1, 1, 1, *[2] * 4)}
"""scales of latent textures in BC1 blocks, by their bits a texel. More and smaller ones, with more reads, are better:
at 10 bits (1, 1, 2, 2) is 0.5 dB lower, (1, 2 five times, 4 four times) 0.3 dB higher; at 5 bits (2 four times, 4 four
times) is 0.2 dB higher (PavingStones070; those of 2.5 and 16 bits were not compared)."""
BLOCK_QUALITIES = {"low": 5.0, "medium": 10.0, "high": 16.0}
BLOCK_RATE = 2.0  # of the optimizer, in steps of the blocks' integers; 1 is 0.02 to 0.16 dB worse (PavingStones070)


@dataclass(frozen=True)
class Effort:
    """Steps of a run, each of `tiles` squares of 32 x 32 texels."""

    steps: int
    tiles: int


def effort_of(device: wp.Device, preview: bool, texels: int) -> Effort:
    """texels: of all levels. From a megatexel on, on the CPU from 512 x 512, steps grow with them, up to 16 times."""
    if device.is_cuda:
        effort, enough = Effort(4_000 if preview else 20_000, 64), 2**20
    else:
        effort, enough = Effort(2_000 if preview else 14_000, 4), 2**18
    return replace(effort, steps=round(min(max(texels / enough, 1), 16) * effort.steps))


def spec_of(height: int, width: int, channels: int, mips: int, bits: float) -> TextureSpec:
    """bits: a texel of mip 0, about."""
    grids = FEW if bits < MANY_FROM else MANY
    if mips > 1:  # the level of detail takes an input
        grids = (*grids[:-1], replace(grids[-1], channels=grids[-1].channels - 1))
    return TextureSpec(height, width, channels, mips, grids)


def fixed_spec(height: int, width: int, channels: int, mips: int, bits: float) -> TextureSpec:
    """With at most so many bits of latents a texel of mip 0, of all levels."""
    return _largest([TextureSpec(height, width, channels, mips, grids) for grids in FIXED.values()], bits)


def block_spec(height: int, width: int, channels: int, mips: int, bits: float) -> BlockSpec:
    """As `fixed_spec`, in blocks."""
    return _largest([BlockSpec(height, width, channels, mips, scales) for scales in BLOCKS.values()], bits)


def _largest(specs: Sequence[TextureSpec | BlockSpec], bits: float) -> TextureSpec | BlockSpec:
    fitting = [spec for spec in specs if spec.resident_bits <= bits]
    if not fitting:
        least = min(spec.resident_bits for spec in specs)
        raise InputError(f"bpp {bits:g}: latents of this texture take at least {least:.3g} bits a texel; give that")
    return max(fitting, key=lambda spec: spec.resident_bits)


def weight_for(bits: float) -> float:
    """A first guess of lambda for so many bits a texel, from what pictures of stone, brick and metal take."""
    return 1.1e-3 / bits**1.4


def precision_for(rate_weight: float) -> float:
    """Finer steps of the weights where errors are small: rms / 12 at a bit a texel, / 64 from 7 bits."""
    return 12.0 if rate_weight > 5e-4 else 32.0 if rate_weight > 5e-5 else 64.0


def beside_latents(spec: TextureSpec, precision: float) -> float:
    """Bits of a file beside those of its latents, about: weights, contexts, header."""
    weights = sum(prod(shape) for shape in spec.tensors.values())
    return weights * (2 + log2(precision)) + 8 * 1200
