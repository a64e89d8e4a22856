"""The bits that latents cost, and their gradients: a Laplace distribution of its own width for each channel of a grid.

What is coded follows a finer model, fitted to the latents in the end (`warp_neural.texture.contexts`); as what drives
the latents this one gives better pictures.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.texture.features import side
from warp_neural.kernels.texture.layout import Layout
from warp_neural.kernels.texture.levels import TILE, TextureData, cell_of
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.training.progress import Progress

FLOOR = wp.constant(2.0**-24)  # of a probability, as a coder has
LEAST = wp.constant(0.02)  # sigma
LOG2E = wp.constant(1.4426950408889634)


@wp.func
def sigma_of(scale: float) -> float:
    """LEAST + softplus(scale)."""
    return LEAST + wp.max(scale, 0.0) + wp.log(1.0 + wp.exp(-wp.abs(scale)))


@wp.func
def laplace_bits(q: float, sigma: float) -> wp.vec3:
    """Bits of a latent, and their derivatives in q and in sigma: of the mass of a Laplace distribution of mean 0 and
    mean deviation sigma between q - 1/2 and q + 1/2."""
    d = wp.abs(q)
    inverse = 1.0 / sigma
    p, in_d, in_sigma = float(0.0), float(0.0), float(0.0)
    if d < 0.5:
        u = 0.5 * wp.exp(-(0.5 + d) * inverse)
        v = 0.5 * wp.exp(-(0.5 - d) * inverse)
        p = 1.0 - u - v
        in_d = (u - v) * inverse
        in_sigma = -(u * (0.5 + d) + v * (0.5 - d)) * inverse * inverse
    else:
        e = wp.exp(-inverse)
        tail = 0.5 * wp.exp(-(d - 0.5) * inverse)
        p = (1.0 - e) * tail
        in_d = -p * inverse
        in_sigma = (p * (d - 0.5) - e * tail) * inverse * inverse
    factor = -LOG2E / (p + FLOOR)
    return wp.vec3(-wp.log(p + FLOOR) * LOG2E, factor * in_d * wp.where(q < 0.0, -1.0, 1.0), factor * in_sigma)


@cache
def make_rate_kernel(spec: TextureSpec, g: int) -> wp.Kernel:
    """Adds to the gradient of latents, and to `data.sums` of its tile. dim [tiles, rows of cells, channels]."""
    grid, start = spec.grids[g], Layout(spec).places[f"scale_{g}"].start
    scale, channels, n, cells = grid.scale, grid.channels, side(grid.scale), TILE // grid.scale
    column_of_sums = start - Layout(spec).kernels_end

    @wp.kernel(module="unique", enable_backward=False)
    def rate_kernel(progress: Progress, data: TextureData, tiles: int, noisy: wp.array[float]):
        t, row, c = wp.tid()
        step = progress.counters[0]
        tile = data.tiles[step * tiles + t]
        first = data.levels.first[tile[0], g] + c
        weight = data.levels.rate[tile[0]] * data.rate_weight[step] * progress.scale[step % 2]
        sigma = sigma_of(data.kernels[start + c])
        bits, in_sigma = float(0.0), float(0.0)
        for column in range(cells):
            rate = laplace_bits(noisy[((t * n + row) * n + column) * channels + c], sigma)
            bits += rate[0]
            in_sigma += rate[2]
            if step < data.latents_until:
                cell = cell_of(data.levels, tile, g, scale, row, column)
                wp.atomic_add(data.gradient, first + cell * channels, weight * rate[1])
        wp.atomic_add(data.sums, t, column_of_sums + c, wp.vec2(weight * in_sigma, bits))

    return rate_kernel
