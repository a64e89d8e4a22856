"""Neural textures of every kind of map, their texels in kernels, and trilinear samples in float64."""

from dataclasses import replace
from functools import cache

import numpy as np
import warp as wp
from wntc_states import SMALL, make_state

from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.texture.state import Map, Tensor
from warp_neural.texture.texture import Texture

MAPS = (
    Map("albedo", "srgb", (0.0,) * 3, (1.0,) * 3),
    Map("normal", "normal", (0.0,) * 3, (1.0,) * 3),
    Map("rough", "linear", (0.0,), (1.0,)),
    Map("sky", "hdr", (-4.0,) * 3, (3.0,) * 3),
    Map("grey", "srgb", (0.0, 0.25), (1.0, 0.25)),
    Map("leaf", "srgb", (0.0,) * 4, (1.0,) * 4),
    Map("height", "linear", (-2.0,), (5.0,)),
)
"""16 channels that vary"""


def make_texture(device, height=40, width=56, mips=4, maps=MAPS, seed=3):
    """Results of the network spread over 0 to 1, and beyond."""
    channels = sum(len(each.trained) for each in maps)
    state = make_state(TextureSpec(height, width, channels, mips, SMALL, (16,)), seed=seed)
    rng, tensors = np.random.default_rng(seed), dict(state.tensors)
    for name, spread, centre in (("weights_0", 0.3, 0), ("weights_1", 0.1, 0), ("biases_1", 0.1, 0.5)):
        values = rng.normal(centre, spread, tensors[name].integers.shape)
        tensors[name] = Tensor(np.round(256 * values).astype(np.int32), 1 / 256)
    return Texture(replace(state, maps=maps, tensors=tensors), device)


def results_of(decoder, mip):
    """[height, width, channels]: results of the network as threads have them that read single texels."""
    height, width = decoder.spec.size(mip)
    values = wp.empty((height, width, decoder.spec.channels), dtype=float, device=decoder.device)
    decoder.decode_alone(mip, (0, 0, width, height), values)
    return values.numpy()


@cache
def make_texels_kernel(texel, params_type, channels):
    @wp.kernel(module="unique", enable_backward=False)
    def texels_kernel(params: params_type, places: wp.array[wp.vec3i], values: wp.array2d[float]):
        n = wp.tid()
        y = texel(params, places[n][0], places[n][1], places[n][2])
        for c in range(channels):
            values[n, c] = y[c]

    return texels_kernel


@cache
def make_samples_kernel(sample, params_type, channels):
    @wp.kernel(module="unique", enable_backward=False)
    def samples_kernel(params: params_type, points: wp.array[wp.vec3], values: wp.array2d[float]):
        n = wp.tid()
        y = sample(params, wp.vec2(points[n][0], points[n][1]), points[n][2])
        for c in range(channels):
            values[n, c] = y[c]

    return samples_kernel


def texels(maps, places, channels, device):
    """Of rows (i, j, mip), [rows, channels]."""
    values = wp.zeros((len(places), channels), dtype=float, device=device)
    inputs = [maps.params, wp.array(places, dtype=wp.vec3i, device=device), values]
    wp.launch(make_texels_kernel(maps.texel, maps.Params, channels), len(places), inputs, device=device)
    return values.numpy()


def samples(maps, points, channels, device):
    """Of rows (u, v, lod), [rows, channels]."""
    values = wp.zeros((len(points), channels), dtype=float, device=device)
    inputs = [maps.params, wp.array(points, dtype=wp.vec3, device=device), values]
    wp.launch(make_samples_kernel(maps.sample, maps.Params, channels), len(points), inputs, device=device)
    return values.numpy()


def trilinear(levels, points):
    """Of levels [height, width, channels] as in the docstring of `Texture.sample`."""
    result = []
    for u, v, lod in np.float64(np.float32(points)):
        lod = np.clip(lod, 0, len(levels) - 1)
        total = 0.0
        for mip, share in ((int(lod), 1 - lod % 1), (min(int(lod) + 1, len(levels) - 1), lod % 1)):
            height, width, _ = levels[mip].shape
            x, y = u * width - 0.5, v * height - 0.5
            j, i = int(np.floor(x)), int(np.floor(y))
            for di, dj in np.ndindex(2, 2):
                weight = abs(1 - di - (y - i)) * abs(1 - dj - (x - j))
                total = total + share * weight * np.float64(levels[mip][(i + di) % height, (j + dj) % width])
        result.append(total)
    return np.array(result)


def channels_of(maps, arrays):
    """Maps as stored, by name, to the channels that vary, [height, width, channels]."""
    return np.concatenate([arrays[each.name][..., list(each.trained)] for each in maps], axis=-1)


def random_points(rng, count, mips):
    points = rng.uniform(-1.5, 2.5, (count, 3)).astype(np.float32)
    points[:, 2] = rng.uniform(-1, mips + 1, count)
    return points
