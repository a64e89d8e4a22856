"""Grids to the network's inputs and back: kernels of a training step, for one grid each.

A step takes tiles of `TILE` x `TILE` texels; sample i is texel (i / TILE % TILE, i % TILE) of tile i / TILE^2. The
latents of its cells and the next ones lie in `noisy` [tile, row, column, channel], with noise or rounded.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.nn.random import stream, uniform
from warp_neural.kernels.texture.layout import Layout
from warp_neural.kernels.texture.levels import TILE, TextureData, cell_of
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.texture.taps import make_taps
from warp_neural.kernels.training.progress import Progress

NOISE = wp.constant(2)  # purpose of the random numbers
ROWS = 4  # of a cell's texels that a thread of `adjoint` takes


def side(scale: int) -> int:
    """Cells of a tile, each way, with the next ones."""
    return TILE // scale + 1


@cache
def make_rounded(bits: int) -> wp.Function:
    """`(latent) -> latent`, a whole number within the bits."""
    limit, one_bit = float(max(2 ** (bits - 1) - 1, 1)), bits == 1

    @wp.func
    def rounded(latent: float) -> float:
        if wp.static(one_bit):
            return wp.where(latent < 0.0, -1.0, 1.0)
        return wp.clamp(wp.rint(latent), -limit, limit)

    return rounded


@cache
def make_disturb_kernel(spec: TextureSpec, g: int) -> wp.Kernel:
    """Latents to `noisy`. dim [tiles, side, side, ceil(channels / 4)]."""
    grid, rounded = spec.grids[g], make_rounded(spec.grids[g].bits)
    scale, channels, groups = grid.scale, grid.channels, -(-grid.channels // 4)
    step_size, n = (2.0 if grid.bits == 1 else 1.0), side(grid.scale)

    @wp.kernel(module="unique", enable_backward=False)
    def disturb_kernel(progress: Progress, data: TextureData, tiles: int, noisy: wp.array[float]):
        t, row, column, group = wp.tid()
        step = progress.counters[0]
        tile = data.tiles[step * tiles + t]
        cell = cell_of(data.levels, tile, g, scale, row, column)
        source = data.levels.first[tile[0], g] + cell * channels + group * 4
        target = ((t * n + row) * n + column) * channels + group * 4
        noise = wp.vec4()
        if step < data.noise_until:
            random = stream(progress.seed, step, cell * groups + group, NOISE)
            noise = uniform(random, tile[0] * 8 + g) - wp.vec4(0.5)
        for c in range(4):
            if group * 4 + c < channels:
                latent = data.latents[source + c]
                noisy[target + c] = wp.where(step < data.noise_until, latent + step_size * noise[c], rounded(latent))

    return disturb_kernel


@cache
def make_features_kernel(spec: TextureSpec, g: int, dtype: type) -> wp.Kernel:
    """`noisy` to the columns of the grid in `encoded`. dim [tiles, TILE, cells of a row, channels]."""
    grid, taps = spec.grids[g], make_taps(spec, g)
    scale, channels, n = grid.scale, grid.channels, side(grid.scale)
    first = sum(each.channels for each in spec.grids[:g])
    detail = spec.n_in - 1 if spec.mips > 1 and g == 0 else -1

    @wp.kernel(module="unique", enable_backward=False)
    def features_kernel(
        progress: Progress, data: TextureData, tiles: int, noisy: wp.array[float], encoded: wp.array2d[dtype]
    ):
        t, y, column, c = wp.tid()
        row = y / scale
        at = ((t * n + row) * n + column) * channels + c
        q = wp.vec4(noisy[at], noisy[at + channels], noisy[at + n * channels], noisy[at + (n + 1) * channels])
        i = (t * TILE + y) * TILE + column * scale
        for px in range(scale):
            encoded[i + px, first + c] = dtype(wp.dot(taps(data.kernels, c, y - row * scale, px), q))
        if wp.static(detail >= 0):
            if c < scale:  # a thread for each texel, or several
                level = data.tiles[progress.counters[0] * tiles + t][0]
                for px in range(c, scale, channels):
                    encoded[i + px, detail] = dtype(data.levels.detail[level])

    return features_kernel


@cache
def make_adjoint_kernel(spec: TextureSpec, g: int, dtype: type) -> wp.Kernel:
    """The gradients to `encoded` to those of the latents. dim [tiles, TILE / rows, cells of a row, channels], where
    rows is `adjoint_rows`."""
    grid, taps = spec.grids[g], make_taps(spec, g)
    scale, channels, rows = grid.scale, grid.channels, adjoint_rows(grid.scale)
    first = sum(each.channels for each in spec.grids[:g])

    @wp.kernel(module="unique", enable_backward=False)
    def adjoint_kernel(progress: Progress, data: TextureData, tiles: int, encoded: wp.array2d[dtype]):
        t, part, column, c = wp.tid()
        row = part * rows / scale
        py = part * rows - row * scale
        gradient = wp.vec4()
        i = (t * TILE + part * rows) * TILE + column * scale
        k = int(0)
        while k < wp.static(rows * scale):  # not unrolled
            y, px = k / scale, k % scale
            gradient += float(encoded[i + y * TILE + px, first + c]) * taps(data.kernels, c, py + y, px)
            k += 1
        step = progress.counters[0]
        if not wp.isfinite(gradient):
            progress.flags[step % 2] = 1
        tile = data.tiles[step * tiles + t]
        start = data.levels.first[tile[0], g] + c
        for tap in range(4):
            cell = cell_of(data.levels, tile, g, scale, row + tap / 2, column + tap % 2)
            wp.atomic_add(data.gradient, start + cell * channels, gradient[tap])

    return adjoint_kernel


def adjoint_rows(scale: int) -> int:
    return min(scale, ROWS)


def kernel_parts(scale: int) -> int:
    """Of a tile, so that a thread takes at most 16 cells."""
    cells = TILE // scale
    return max(cells * cells // 16, 1)


@cache
def make_kernel_adjoint_kernel(spec: TextureSpec, g: int, dtype: type) -> wp.Kernel:
    """The gradients to `encoded` to those of the grid's kernel. dim [tiles * parts, scale, scale, channels], where
    parts is `kernel_parts`, each some rows of cells."""
    grid, places = spec.grids[g], Layout(spec).places
    scale, channels, n, cells = grid.scale, grid.channels, side(grid.scale), TILE // grid.scale
    first, parts = sum(each.channels for each in spec.grids[:g]), kernel_parts(grid.scale)
    learned = grid.kernel == "learned"
    start = places[f"kernel_{g}" if learned else f"kernel_{g}_y"].start
    start_x = 0 if learned else places[f"kernel_{g}_x"].start

    @wp.kernel(module="unique", enable_backward=False)
    def kernel_adjoint_kernel(data: TextureData, noisy: wp.array[float], encoded: wp.array2d[dtype]):
        part, py, px, c = wp.tid()
        t = part / parts
        s = wp.vec4()
        i = (part - t * parts) * wp.static(cells * cells // parts)
        end = i + wp.static(cells * cells // parts)
        while i < end:  # not unrolled
            row = i / cells
            column = i % cells
            at = ((t * n + row) * n + column) * channels + c
            q = wp.vec4(noisy[at], noisy[at + channels], noisy[at + n * channels], noisy[at + (n + 1) * channels])
            s += q * float(encoded[(t * TILE + row * scale + py) * TILE + column * scale + px, first + c])
            i += 1
        if wp.static(learned):
            k = start + (py * scale + px) * 4 * channels + c
            for tap in range(4):
                wp.atomic_add(data.kernels_gradient, k + tap * channels, s[tap])
        else:
            i = start + py * 2 * channels + c
            j = start_x + px * 2 * channels + c
            x0, x1 = data.kernels[j], data.kernels[j + channels]
            y0, y1 = data.kernels[i], data.kernels[i + channels]
            wp.atomic_add(data.kernels_gradient, i, s[0] * x0 + s[1] * x1)
            wp.atomic_add(data.kernels_gradient, i + channels, s[2] * x0 + s[3] * x1)
            wp.atomic_add(data.kernels_gradient, j, s[0] * y0 + s[2] * y1)
            wp.atomic_add(data.kernels_gradient, j + channels, s[1] * y0 + s[3] * y1)

    return kernel_adjoint_kernel
