"""Where latents and texels of all levels lie in memory, and what a training step reads and writes."""

import warp as wp

TILE = 32  # texels a side of what a step takes at once, a place of one level; a multiple of every scale


@wp.struct
class Levels:
    """Latents of level m and grid g: those of cell (row, column) from `first[m, g] + (row * columns[m, g] + column) *
    channels` on. Texels of level m, row by row, from `texels[m]` on; sizes[m]: height and width; padded[m]: the same in
    whole cells of the coarsest grid, where all wraps. detail[m]: level of detail, the network's last input. rate[m]: a
    factor of the weight of its bits.
    """

    first: wp.array2d[int]
    rows: wp.array2d[int]
    columns: wp.array2d[int]
    texels: wp.array[int]
    sizes: wp.array[wp.vec2i]
    padded: wp.array[wp.vec2i]
    detail: wp.array[float]
    rate: wp.array[float]


@wp.struct
class TextureData:
    """Of a training run. tiles [steps * tiles of a step]: level, row and column of the first texel, multiples of the
    coarsest scale. targets [texels of all levels, what the loss takes]: NaN where any value will do.

    latents, their gradient and both moments: of all levels and grids. kernels: weights of the taps, as decoders have
    them, and the scales of the rate (`Layout`); their gradient. Of each step: rate_weight, the loss of a bit a texel;
    latent_rate, of the optimizer. Latents are noisy before step `noise_until`, then rounded, from `latents_until` on at
    rest. bits: of the latents of step i at i % length, summed.
    """

    levels: Levels
    tiles: wp.array[wp.vec3i]
    targets: wp.array2d[float]
    latents: wp.array[float]
    gradient: wp.array[float]
    first: wp.array[float]
    second: wp.array[float]
    kernels: wp.array[float]
    kernels_gradient: wp.array[float]
    rate_weight: wp.array[float]
    latent_rate: wp.array[float]
    noise_until: int
    latents_until: int
    sums: wp.array2d[wp.vec2]
    bits: wp.array[float]


@wp.func
def wrapped(i: int, n: int) -> int:
    """i >= 0 into 0 to n - 1."""
    return wp.where(i < n, i, i % n)


@wp.func
def cyclic(i: int, n: int) -> int:
    """Any i into 0 to n - 1."""
    k = i % n
    return wp.where(k < 0, k + n, k)


@wp.func
def place_of(levels: Levels, i: int, j: int, mip: int) -> wp.vec3i:
    """The nearest level that there is, and row and column in it, which wrap, of any numbers."""
    level = wp.clamp(mip, 0, levels.sizes.shape[0] - 1)
    size = levels.sizes[level]
    return wp.vec3i(level, cyclic(i, size[0]), cyclic(j, size[1]))


@wp.func
def cell_of(levels: Levels, tile: wp.vec3i, grid: int, scale: int, row: int, column: int) -> int:
    """The number, in its grid, of a cell of a tile."""
    i = wrapped(tile[1] / scale + row, levels.rows[tile[0], grid])
    j = wrapped(tile[2] / scale + column, levels.columns[tile[0], grid])
    return i * levels.columns[tile[0], grid] + j
