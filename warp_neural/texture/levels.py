"""The arrays of all levels of a texture, and the order in which a training run takes their tiles."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_neural.kernels.texture.levels import TILE, Levels
from warp_neural.kernels.texture.spec import DETAIL_SCALE, BlockSpec, TextureSpec

COARSER = (
    1.4  # of the weight of bits in all levels but the finest: at 1 the finest is 0.05 to 0.2 dB lower at equal bits
)


def make_levels(spec: TextureSpec | BlockSpec, device: wp.Device) -> Levels:
    """Level by level; what is by grid too is empty where there are no grids."""
    sizes = np.array(spec.all_sizes)
    levels = Levels()
    first, cells = np.zeros((0, 0)), np.zeros((0, 0, 2))
    if isinstance(spec, TextureSpec):
        cells = np.array([[spec.cells(m, g) for g in range(len(spec.grids))] for m in range(spec.mips)])  # [m, g, 2]
        first = first_latents(spec)[:-1].reshape(cells.shape[:2])
    levels.first = wp.array(first, dtype=int, device=device)
    levels.rows = wp.array(cells[..., 0], dtype=int, device=device)
    levels.columns = wp.array(cells[..., 1], dtype=int, device=device)
    levels.texels = wp.array(np.cumsum([0, *sizes.prod(1)[:-1]]), dtype=int, device=device)
    levels.sizes = wp.array(sizes, dtype=wp.vec2i, device=device)
    levels.padded = wp.array(padded_sizes(spec), dtype=wp.vec2i, device=device)
    levels.rate = wp.array(np.where(np.arange(spec.mips) > 0, COARSER, 1.0), dtype=float, device=device)
    levels.detail = wp.array(np.arange(spec.mips) / DETAIL_SCALE, dtype=float, device=device)
    return levels


def first_latents(spec: TextureSpec) -> np.ndarray:
    """Where the latents of each level and grid begin, and the end of all. [mips * grids + 1]"""
    counts = [np.prod(spec.cells(m, g)) * grid.channels for m in range(spec.mips) for g, grid in enumerate(spec.grids)]
    return np.cumsum([0, *counts])


def padded_sizes(spec: TextureSpec | BlockSpec) -> np.ndarray:
    """Texels of each level in whole cells of the coarsest grid. [mips, 2]"""
    return -(-np.array(spec.all_sizes) // spec.period) * spec.period


def split_latents(spec: TextureSpec, flat: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    """[rows, columns, channels] of each level and grid: views."""
    starts = iter(np.split(flat, first_latents(spec)[1:-1]))
    return tuple(
        tuple(next(starts).reshape(*spec.cells(m, g), grid.channels) for g, grid in enumerate(spec.grids))
        for m in range(spec.mips)
    )


def tiles_of(spec: TextureSpec | BlockSpec, level: int, offset: Sequence[int] = (0, 0)) -> np.ndarray:
    """(level, row, column) of the tiles that cover a level. [tiles, 3]"""
    sides = zip(padded_sizes(spec)[level], offset, strict=True)
    rows, columns = (np.arange(-(-side // TILE)) * TILE + first for side, first in sides)
    grid = np.stack(np.meshgrid(level, rows, columns, indexing="ij"), -1).reshape(-1, 3)
    grid[:, 1:] %= padded_sizes(spec)[level]
    return grid


def tile_order(spec: TextureSpec | BlockSpec, count: int, random: np.random.Generator) -> np.ndarray:
    """All tiles of all levels in random order, again and again, each time from other places. [count, 3]"""
    scale, rounds, total = spec.period, [], 0
    while total < count:
        offsets = random.integers(0, TILE // scale, (spec.mips, 2)) * scale
        tiles = np.concatenate([tiles_of(spec, m, offsets[m]) for m in range(spec.mips)])
        rounds.append(tiles[random.permutation(len(tiles))])
        total += len(tiles)
    return np.concatenate(rounds)[:count].astype(np.int32)


def all_tiles(spec: TextureSpec | BlockSpec) -> int:
    """Of all levels."""
    return sum(len(tiles_of(spec, m)) for m in range(spec.mips))
