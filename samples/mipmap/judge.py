"""How wrong maps are on light and view pairs that training never draws from."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural.materials.shading import display, uniform_hemisphere
from warp_neural.samples.mipmap.maps import Maps, load_channels, pack, packed_shade
from warp_neural.samples.mipmap.threads import threads

BATCHES = 16


@wp.func
def shade_mean(source: wp.array3d[float], t: int, light: wp.vec3, view: wp.vec3) -> wp.vec3:
    """The truth: what a viewer sees who cannot tell the source's texels under texel `t` apart."""
    color = wp.vec3(0.0)
    for k in range(source.shape[0]):
        color += packed_shade(load_channels(source[k], t), light, view)
    return color / float(source.shape[0])


@wp.kernel(enable_backward=False)
def judge_kernel(
    source: wp.array3d[float],  # [texels of the source under a texel, n, 8]
    candidates: wp.array3d[float],  # [candidates, n, 8]
    seed: wp.uint64,
    first_batch: int,
    pairs: int,
    linear: wp.array3d[float],  # [candidates, batches, n], sums over pairs of the mean square over RGB
    displayed: wp.array3d[float],
):
    """Squared errors of radiance and of displayed values over uniform pairs, new ones for each texel and batch."""
    b, t = wp.tid()
    random = wn.random.stream(seed, first_batch + b, t, wn.random.HELD_OUT)
    for pair in range(pairs):
        u = wn.random.uniform(random, pair)
        light, view = uniform_hemisphere(u[0], u[1]), uniform_hemisphere(u[2], u[3])
        truth = shade_mean(source, t, light, view)
        shown_truth = display(truth)
        for c in range(linear.shape[0]):
            color = packed_shade(load_channels(candidates[c], t), light, view)
            error = color - truth
            shown = display(color) - shown_truth
            linear[c, b, t] = linear[c, b, t] + wp.dot(error, error) / 3.0
            displayed[c, b, t] = displayed[c, b, t] + wp.dot(shown, shown) / 3.0


@wp.kernel(enable_backward=False)
def picture_kernel(
    source: wp.array3d[float],
    candidates: wp.array3d[float],
    lights: wp.array[wp.vec3],  # [pictures]
    views: wp.array[wp.vec3],
    pictures: wp.array3d[wp.vec3],  # [1 + candidates, pictures, n], displayed values
):
    """The truth and every candidate as pictures under one light and view each."""
    p, t = wp.tid()
    pictures[0, p, t] = display(shade_mean(source, t, lights[p], views[p]))
    for c in range(pictures.shape[0] - 1):
        pictures[c + 1, p, t] = display(packed_shade(load_channels(candidates[c], t), lights[p], views[p]))


def no_bar(parts: Iterable, total: int) -> Iterable:
    return parts


@dataclass(frozen=True)
class Errors:
    """Mean squared errors of each candidate, `[candidates]`, with the standard error of each mean."""

    linear: np.ndarray
    linear_spread: np.ndarray
    displayed: np.ndarray
    displayed_spread: np.ndarray


def judge(source: wp.array, candidates: list[Maps], *, pairs: int, seed: int, bar: Callable = no_bar) -> Errors:
    """Errors over `pairs` uniform pairs a texel, in 16 batches; spread is the standard error over the batches."""
    device, texels = source.device, source.shape[1]
    planes = _planes(candidates, device)
    launches = 1 if device.is_cuda else BATCHES
    batches = BATCHES // launches

    def some(launch: int) -> np.ndarray:
        sums = wp.zeros((2, len(candidates), batches, texels), dtype=float, device=device)
        inputs = [source, planes, seed, launch * batches, max(pairs // BATCHES, 1), sums[0], sums[1]]
        wp.launch(judge_kernel, dim=(batches, texels), inputs=inputs, device=device)
        return sums.numpy().mean(axis=-1, dtype=np.float64) / max(pairs // BATCHES, 1)  # [2, candidates, batches]

    wp.load_module(judge_kernel.module, device=device)  # before the threads, or each compiles it
    with threads(device) as (pool, _going):
        errors = np.concatenate(list(bar(pool.map(some, range(launches)), total=launches)), axis=-1)
    spread = errors.std(axis=-1, ddof=1) / np.sqrt(errors.shape[-1])
    mean = errors.mean(axis=-1)
    return Errors(linear=mean[0], linear_spread=spread[0], displayed=mean[1], displayed_spread=spread[1])


def render(source: wp.array, candidates: list[Maps], lights: np.ndarray, views: np.ndarray) -> np.ndarray:
    """Displayed pictures `[1 + candidates, pictures, height, width, 3]`, the truth first; lights `[pictures, 3]`."""
    device, texels = source.device, source.shape[1]
    pictures = wp.empty((1 + len(candidates), len(lights), texels), dtype=wp.vec3, device=device)
    directions = [wp.array(d, dtype=wp.vec3, device=device) for d in (lights, views)]
    inputs = [source, _planes(candidates, device), *directions, pictures]
    wp.launch(picture_kernel, dim=pictures.shape[1:], inputs=inputs, device=device)
    return pictures.numpy().reshape(*pictures.shape[:2], *candidates[0].shape, 3)


def random_directions(count: int, seed: int) -> np.ndarray:
    """Uniform on the hemisphere, `[count, 3]`."""
    draws = np.random.default_rng(seed).random((count, 2))
    phi, z = 2 * np.pi * draws[:, 0], draws[:, 1]
    sine = np.sqrt(1 - z * z)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=-1).astype(np.float32)


def flip(truth: np.ndarray, picture: np.ndarray) -> float:
    """FLIP (Andersson et al. 2020), the mean over pictures; its default viewing distance of 67 pixels a degree."""
    import flip_evaluator

    errors = [flip_evaluator.evaluate(t, p, "LDR", applyMagma=False)[1] for t, p in zip(truth, picture, strict=True)]
    return float(np.mean(errors))


def _planes(candidates: list[Maps], device: wp.Device) -> wp.array:
    planes = [pack(maps, 1, device).numpy() for maps in candidates]
    return wp.array(np.concatenate(planes), dtype=float, device=device)
