"""`compress`: from pictures to a `Texture`, of a wanted size or quality."""

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import log
from pathlib import Path
from typing import Any, Literal

import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.errors import is_finite, require, require_whole
from warp_neural.kernels.texture.losses import Cost
from warp_neural.texture.checkpoint import Checkpoint
from warp_neural.texture.files import make_texture
from warp_neural.texture.job import Job, Storage, make_job
from warp_neural.texture.maps import load_set
from warp_neural.texture.measure import channel_errors, psnr
from warp_neural.texture.presets import (
    BLOCK_QUALITIES,
    FIXED_QUALITIES,
    QUALITIES,
    beside_latents,
    effort_of,
    precision_for,
    weight_for,
)
from warp_neural.texture.search import Goal, meet
from warp_neural.texture.texture import Texture

BITS_TOLERANCE = 0.02  # of the size; 3 % are promised
PSNR_TOLERANCE = 0.07  # dB; 0.1 are promised
BITS_SLOPE = -0.7  # of log(bits) by log(lambda)
PSNR_SLOPE = -2.2  # dB
BITS_TO_COME = -0.42, -0.28, -0.2, -0.13, -0.07, -0.025  # of log(bits), from the moments of a search; three materials
PSNR_TO_COME = 1.8, 1.5, 1.2, 1.0, 0.85, 0.75  # dB; less than 1 where it ends below 35, more above
SURE = 0.75  # of what is expected beside latents


def compress(
    source: Any,
    *,
    bpp: float | None = None,
    psnr: float | None = None,
    size: int | None = None,
    quality: Literal["low", "medium", "high"] | None = None,
    storage: Storage = "load",
    preview: bool = False,
    steps: int | None = None,
    mips: int | None = None,
    weights: Mapping[str, float] | None = None,
    losses: Mapping[str, Cost] | None = None,
    device: wp.DeviceLike = None,
    seed: int = 0,
    checkpoint: Path | None = None,
    quiet: bool = False,
) -> Texture:
    """A material's maps in a few quantised latent textures and one tiny network.

    source: what `load_set` takes, a folder, files, arrays or a `Material`, or a `TextureSet`. At most one goal: bpp,
    bits a texel of mip 0 with everything counted; size, in bytes, of the file; psnr, in dB, of mip 0, all channels
    together; or a quality, "medium" if nothing is said. Sizes are met within 3 %, PSNR within 0.1 dB; if not, the
    metrics' "goal_met" is False. storage: what is to be small. "load", the file, whose latents take a byte each in
    memory, 14 to 34 bits a texel; "sample", what is in memory while texels are read: latents of 1 or 4 bits each, of
    which bpp is the most that all may take, "resident_bits" in the metrics what they take; psnr and size are no goals
    then; "engine", the same with latents as textures in BC1 blocks, an `EngineTexture`.

    preview: fewer steps. steps: of training, in place of those that device, size and preview lead to. mips: levels in
    the file, those of the source if None. weights: of the errors of maps, by name; 1 if not given. losses: what errors
    of a map cost, by name; "l2", their squares, if not given; of normals "angle"; of colours "luminance", with less for
    errors of chroma. checkpoint: a file to save the run to, every 30 seconds and at Ctrl-C; if it is there, to go on
    from.

    Raises `InputError` for goals that cannot be met.
    """
    begin = time.perf_counter()
    texture_set = load_set(source)
    job = make_job(texture_set, mips, weights, losses, find_device(device), seed, storage)
    effort = effort_of(job.device, preview, job.all_texels)
    if steps is not None:
        require_whole("steps", steps, 100)
        effort = replace(effort, steps=steps)
    given = {"bpp": bpp, "psnr": psnr, "size": size, "quality": quality}
    goal, bits, weight = _plan(job, **given)
    kept = Checkpoint(checkpoint, job.configuration | given | {"effort": list(vars(effort).values())})
    trainer = job.trainer(job.spec(bits), precision_for(weight), effort.steps, effort.tiles, weight)
    first, met = [trainer.snapshot()] if kept.tensors else [], {}
    with kept.kept(trainer) as watch:
        if goal:
            met = {"goal_met": meet(trainer, goal, first, quiet=quiet, watch=watch)}
        else:
            trainer.run(quiet=quiet, watch=watch)
    state = trainer.state(job.maps)
    texture = make_texture(state, job.device)
    errors = _errors(texture, job)
    extra = errors | met | {"seconds": round(time.perf_counter() - begin, 3), "steps": trainer.steps}
    extra |= {"rate_weight": float(f"{trainer.rate_weight:.4g}"), "resident_bits": round(state.spec.resident_bits, 4)}
    return texture.with_metrics(extra)


def _plan(job: Job, **given) -> tuple[Goal | None, float, float]:
    """The goal, the bits a texel that it takes, about, or that latents may take, and lambda to begin with."""
    _check(given)
    if job.storage == "load":
        goal, bits = _goal(job, **given)
        return goal, bits, weight_for(bits) if goal else QUALITIES[given["quality"] or "medium"]
    for name in ("psnr", "size"):
        require(given[name] is None, name, given[name], f'left out with storage "{job.storage}": give bpp or quality')
    levels = 1.1 * job.all_texels / job.texels if len(job.levels) > 1 else 1.0  # small ones are whole cells too
    qualities = FIXED_QUALITIES if job.storage == "sample" else BLOCK_QUALITIES
    bits = qualities[given["quality"] or "medium"] * levels if given["bpp"] is None else given["bpp"]
    return None, bits, 0.0


def _check(given: Mapping[str, Any]) -> None:
    """At most one goal, of a known kind."""
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(f"{' and '.join(named)}: each chooses how good and how large it is; give one of them")
    quality = given["quality"]
    if quality is not None:
        require(quality in QUALITIES, "quality", quality, f"one of {', '.join(QUALITIES)}")
    for name in ("bpp", "psnr", "size"):
        value = given[name]
        if value is not None:
            require(is_finite(value) and value > 0, name, value, "a positive number")


def _goal(
    job: Job, bpp: float | None, psnr: float | None, size: int | None, quality: str | None
) -> tuple[Goal | None, float]:
    """And about how many bits a texel it takes."""
    if psnr is not None:
        return Goal(job.psnr, psnr, PSNR_SLOPE, PSNR_TOLERANCE, PSNR_TO_COME), 1.5 if psnr < 29 else 3.0
    if bpp is None and size is None:
        return None, {"low": 1.0}.get(quality, 4.0)
    bits = bpp if bpp is not None else 8 * size / job.texels
    beside = beside_latents(job.spec(bits), precision_for(weight_for(bits)))
    latents = bits * job.texels - beside
    if latents < beside / 8:
        least = 1.25 * beside
        wanted, enough = (
            (f"bpp {bpp:g}", f"{least / job.texels:.3g}")
            if size is None
            else (f"size {size}", f"{least / 8:.0f} bytes")
        )
        raise InputError(
            f"{wanted}: the network takes {beside / 8e3:.1f} kB; give at least {enough}, or fewer, larger textures"
        )
    less, rest = SURE * beside, (1 - SURE) * beside
    tolerance = BITS_TOLERANCE * bits * job.texels / (latents + rest)
    measure = partial(job.log_coded, less=less)
    return Goal(measure, log(latents + rest), BITS_SLOPE, tolerance, BITS_TO_COME), bits


def _errors(texture: Texture, job: Job) -> dict[str, Any]:
    """Of mip 0 by map, and the PSNR of each mip."""
    results = [texture.decoder.decode(mip) for mip in range(len(job.levels))]
    errors = channel_errors(job.levels[0], results[0], job.maps)
    return errors | {"psnr_of_mips": [psnr(a, b) for a, b in zip(job.levels, results, strict=True)]}
