"""What a neural texture consists of: grids of latents, kernels that read them, and a network; sizes only.

Texel (i, j) of mip m reads grid g at cell (i // s, j // s) and the next ones to the right and below, wrapping; each
channel sums the four latents with weights that depend on the texel's place in its cell, its phase. The channels of all
grids, and the level of detail where there are mips, enter the network, whose results are the texture's channels.
"""

from dataclasses import dataclass
from math import prod
from typing import Literal

from warp_neural.kernels.errors import require, require_whole

LARGEST_SIDE = 16384
LARGEST_CHANNELS = 16
BLOCK_CHANNELS = 3  # of a texture of BC1 blocks
DETAIL_SCALE = 8  # the level of detail enters the network divided by this
TAPS = 4  # latents of the cell, of the next to the right, of the next below, of the one right and below
KERNELS = ("learned", "separable", "bilinear")


@dataclass(frozen=True)
class Grid:
    """One latent vector of `channels` integers for each cell of scale x scale texels.

    kernel: the weights of the four taps, of each channel and phase: all trained ('learned', [channels, scale, scale,
    4]), products of two trained vectors ('separable', two of [channels, scale, 2]), or `BILINEAR` times those of
    bilinear interpolation. bits: latents are -(2^(bits-1) - 1) to 2^(bits-1) - 1, with 1 bit -1 and 1.
    """

    scale: int
    channels: int
    kernel: Literal["learned", "separable", "bilinear"] = "learned"
    bits: int = 8

    def __post_init__(self) -> None:
        require(self.scale in (1, 2, 4, 8, 16, 32), "Grid: scale", self.scale, "a power of two, 1 to 32")
        require_whole("Grid: channels", self.channels, 1, 32)
        require(self.kernel in KERNELS, "Grid: kernel", self.kernel, f"one of {', '.join(KERNELS)}")
        require_whole("Grid: bits", self.bits, 1, 8)

    @property
    def limit(self) -> int:
        """The largest latent."""
        return max(2 ** (self.bits - 1) - 1, 1)

    @property
    def resident_bits(self) -> int:
        """Of a latent in a device's memory: 1, 2, 4 or 8."""
        return 1 << (self.bits - 1).bit_length()


@dataclass(frozen=True)
class TextureSize:
    """height, width: of mip 0, in texels. channels: that the network has as results, 1 to 16. mips: levels that the
    texture holds, each half as large as the one before, rounded down."""

    height: int
    width: int
    channels: int
    mips: int

    def __post_init__(self) -> None:
        require_whole("height", self.height, 1, LARGEST_SIDE)
        require_whole("width", self.width, 1, LARGEST_SIDE)
        require_whole("channels", self.channels, 1, LARGEST_CHANNELS)
        require_whole("mips", self.mips, 1, max(self.height, self.width).bit_length())
        for width in self.hidden:
            require_whole("hidden", width, 1, 256)
        require_whole("hidden layers", len(self.hidden), 1, 8)
        require_whole("network inputs", self.n_in, 1, 256)

    @property
    def layers(self) -> tuple[tuple[int, int], ...]:
        """(n_out, n_in) of each layer of the network."""
        sizes = (self.n_in, *self.hidden, self.channels)
        return tuple(zip(sizes[1:], sizes[:-1], strict=True))

    def size(self, mip: int) -> tuple[int, int]:
        """(height, width) of a level, in texels."""
        return max(self.height >> mip, 1), max(self.width >> mip, 1)

    @property
    def all_sizes(self) -> list[tuple[int, int]]:
        return [self.size(mip) for mip in range(self.mips)]


@dataclass(frozen=True)
class TextureSpec(TextureSize):
    """grids: from fine to coarse. hidden: neurons of the hidden layers."""

    grids: tuple[Grid, ...]
    hidden: tuple[int, ...] = (64, 64)

    def __post_init__(self) -> None:
        scales = [grid.scale for grid in self.grids]
        rising = bool(scales) and len(scales) <= 8 and scales == sorted(set(scales))
        require(rising, "grids: scales", scales, "1 to 8 grids, each coarser than the one before")
        super().__post_init__()

    @property
    def n_in(self) -> int:
        """The channels of all grids, and the level of detail if there are mips."""
        return sum(grid.channels for grid in self.grids) + (self.mips > 1)

    @property
    def period(self) -> int:
        """Texels of a cell of the coarsest grid, in whole ones of which all grids wrap and tiles begin."""
        return self.grids[-1].scale

    def cells(self, mip: int, grid: int) -> tuple[int, int]:
        """(rows, columns) of a grid of a level, whole cells of the coarsest grid, where all grids wrap."""
        scale = self.grids[grid].scale
        rows, columns = (-(-side // self.period) * self.period // scale for side in self.size(mip))
        return rows, columns

    @property
    def resident_bits(self) -> float:
        """Of the latents of all levels in a device's memory, a texel of mip 0."""
        grids = [(m, g) for m in range(self.mips) for g in range(len(self.grids))]
        counts = (prod(self.cells(m, g)) * self.grids[g].channels * self.grids[g].resident_bits for m, g in grids)
        return sum(counts) / (self.height * self.width)

    @property
    def tensors(self) -> dict[str, tuple[int, ...]]:
        """The shapes of what the decoder has beside latents, by name, in the order of the file."""
        shapes = {}
        for g, grid in enumerate(self.grids):
            if grid.kernel == "learned":
                shapes[f"kernel_{g}"] = grid.channels, grid.scale, grid.scale, TAPS
            elif grid.kernel == "separable":
                shapes |= dict.fromkeys((f"kernel_{g}_y", f"kernel_{g}_x"), (grid.channels, grid.scale, 2))
        return shapes | layer_shapes(self.layers)


@dataclass(frozen=True)
class BlockSpec(TextureSize):
    """A texture whose latents are themselves textures, with mip levels, of BC1 blocks: three channels in 4 bits, read
    by the bilinear filter of GPUs at the texel's place; no kernels.

    scales: texels of a latent, each way, of each latent texture. The sides of mip 0 are multiples of four times these:
    graphics interfaces want whole blocks there.
    """

    scales: tuple[int, ...]
    hidden: tuple[int, ...] = (64, 64)

    def __post_init__(self) -> None:
        require(0 < len(self.scales) <= 12, "scales", self.scales, "1 to 12 latent textures")
        for scale in self.scales:
            require(scale in (1, 2, 4, 8), "scale", scale, "1, 2, 4 or 8")
            side = 4 * scale
            whole = self.height % side == self.width % side == 0
            require(whole, "size", (self.height, self.width), f"sides that are multiples of {side}; resize the maps")
        super().__post_init__()

    @property
    def n_in(self) -> int:
        """The channels of all latent textures, and the level of detail if there are mips."""
        return BLOCK_CHANNELS * len(self.scales) + (self.mips > 1)

    @property
    def period(self) -> int:
        return 1

    def latents(self, mip: int, g: int) -> tuple[int, int]:
        """(rows, columns) of a latent texture's level."""
        scale = self.scales[g]
        return max(self.height // scale >> mip, 1), max(self.width // scale >> mip, 1)

    def blocks(self, mip: int, g: int) -> tuple[int, int]:
        """(rows, columns) of its blocks."""
        rows, columns = self.latents(mip, g)
        return -(-rows // 4), -(-columns // 4)

    @property
    def resident_bits(self) -> float:
        """Of the blocks of all levels, a texel of mip 0."""
        blocks = sum(prod(self.blocks(m, g)) for m in range(self.mips) for g in range(len(self.scales)))
        return 64 * blocks / (self.height * self.width)

    @property
    def tensors(self) -> dict[str, tuple[int, ...]]:
        """The shapes of the network's parameters, by name."""
        return layer_shapes(self.layers)


def layer_shapes(layers: tuple[tuple[int, int], ...]) -> dict[str, tuple[int, ...]]:
    shapes = {}
    for l, (n_out, n_in) in enumerate(layers):
        shapes |= {f"weights_{l}": (n_out, n_in), f"biases_{l}": (n_out,)}
    return shapes
