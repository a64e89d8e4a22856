"""The optimizer of latents, where a step has reached them, and of kernels and scales: Adam (Kingma and Ba 2015)."""

from functools import cache

import warp as wp

from warp_neural.kernels.nn.optimizers import adam
from warp_neural.kernels.texture.levels import TextureData, cell_of
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.training.progress import Progress, rate_of

SETTINGS = wp.constant(wp.vec4(0.9, 0.99, 1e-8, 0.0))
SCALE_RATE = wp.constant(0.01)


@wp.func
def corrections_of(steps: float) -> wp.vec2:
    return wp.vec2(1.0 / (1.0 - wp.pow(SETTINGS[0], steps)), 1.0 / (1.0 - wp.pow(SETTINGS[1], steps)))


@cache
def make_latents_kernel(spec: TextureSpec, g: int) -> wp.Kernel:
    """dim [tiles, side, side, channels]. share: of all latents, that a step reaches.

    Tiles overlap: who finds the gradient takes it. A latent whose gradient is 0 was not reached, and rests.
    """
    scale, channels, end = spec.grids[g].scale, spec.grids[g].channels, spec.grids[g].limit + 0.45

    @wp.kernel(module="unique", enable_backward=False)
    def latents_kernel(progress: Progress, data: TextureData, tiles: int, share: float):
        t, row, column, c = wp.tid()
        step = progress.counters[1]
        parity = step % 2
        tile = data.tiles[step * tiles + t]
        cell = cell_of(data.levels, tile, g, scale, row, column)
        i = data.levels.first[tile[0], g] + cell * channels + c
        gradient = wp.atomic_exch(data.gradient, i, 0.0)
        if gradient != 0.0 and progress.flags[parity] == 0 and step < data.latents_until:
            state = wp.vec3(data.latents[i], data.first[i], data.second[i])
            corrections = corrections_of(1.0 + float(step) * share)
            state = adam(gradient / progress.scale[parity], state, data.latent_rate[step], corrections, SETTINGS)
            data.latents[i] = wp.clamp(state[0], -end, end)
            data.first[i] = state[1]
            data.second[i] = state[2]

    return latents_kernel


@wp.kernel(enable_backward=False)
def kernels_kernel(
    progress: Progress,
    data: TextureData,
    kernels_end: int,
    steps: wp.array[float],
    values: wp.array[float],
    first: wp.array[float],
    second: wp.array[float],
):
    """dim [values]: before the update of latents. values: what `data.kernels` holds rounded to multiples of `steps`,
    once latents rest."""
    i = wp.tid()
    step = progress.counters[1]
    parity = step % 2
    gradient = data.kernels_gradient[i]
    data.kernels_gradient[i] = 0.0
    if i == 0:
        data.bits[(step + 1) % data.bits.shape[0]] = 0.0
    if i >= kernels_end:
        total = wp.vec2()
        for t in range(data.sums.shape[0]):
            total += data.sums[t, i - kernels_end]
            data.sums[t, i - kernels_end] = wp.vec2()
        gradient = total[0] / (1.0 + wp.exp(-values[i]))  # softplus' derivative
        wp.atomic_add(data.bits, step % data.bits.shape[0], total[1])
    if progress.flags[parity] == 0 and (i < kernels_end or step < data.latents_until):
        rate = wp.where(i < kernels_end, rate_of(progress, step), SCALE_RATE)
        state = wp.vec3(values[i], first[i], second[i])
        state = adam(gradient / progress.scale[parity], state, rate, corrections_of(float(step + 1)), SETTINGS)
        values[i] = state[0]
        first[i] = state[1]
        second[i] = state[2]
        if i < kernels_end and step >= data.latents_until:
            data.kernels[i] = wp.rint(state[0] / steps[i]) * steps[i]
        else:
            data.kernels[i] = state[0]


@wp.kernel(enable_backward=False)
def round_kernel(master: wp.array[float], steps: wp.array[float], rounded: wp.array[float]):
    """dim [parameters of the network]."""
    i = wp.tid()
    rounded[i] = wp.rint(master[i] / steps[i]) * steps[i]
