"""`compress`: from pictures to a `Texture`, of a wanted size or quality."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import log, log10
from pathlib import Path
from typing import Any, Literal
from zlib import crc32

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.errors import is_finite, require
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.texture.checkpoint import Checkpoint
from warp_neural.texture.decoder import Decoder
from warp_neural.texture.file import coded_bits
from warp_neural.texture.levels import padded_sizes
from warp_neural.texture.maps import TextureSet, load_set, mip_chain, without_hidden
from warp_neural.texture.measure import channel_errors, psnr
from warp_neural.texture.presets import QUALITIES, Effort, beside_latents, effort_of, precision_for, spec_of, weight_for
from warp_neural.texture.search import Goal, find, meet
from warp_neural.texture.state import Map
from warp_neural.texture.texture import Texture
from warp_neural.texture.trainer import TextureTrainer

BITS_TOLERANCE = 0.02  # of the size; 3 % are promised
PSNR_TOLERANCE = 0.07  # dB; 0.1 are promised
PSNR_SLOPE = -2.2  # dB a unit of log(lambda)
BITS_SLOPE = -0.8
SURE = 0.75  # of what is expected beside latents
CODED = 0.93  # of the trainer's bits, after contexts are fitted


@dataclass(frozen=True)
class Job:
    """What is to be compressed, and with what."""

    maps: tuple[Map, ...]
    levels: tuple[np.ndarray, ...]
    targets: list[np.ndarray]
    weights: tuple[float, ...]
    device: wp.Device
    seed: int

    @property
    def configuration(self) -> dict[str, Any]:
        """JSON that another job has otherwise."""
        digest = 0
        for level in self.targets:
            digest = crc32(np.ascontiguousarray(level), digest)
        sizes = [list(level.shape) for level in self.levels]
        return {"pictures": digest, "sizes": sizes, "weights": list(self.weights), "seed": self.seed}

    @property
    def texels(self) -> int:
        return self.levels[0].shape[0] * self.levels[0].shape[1]

    def spec(self, bits: float) -> TextureSpec:
        return spec_of(*self.levels[0].shape, len(self.levels), bits)

    def trainer(
        self, spec: TextureSpec, precision: float, steps: int, tiles: int, rate_weight: float
    ) -> TextureTrainer:
        options = {"weights": self.weights, "seed": self.seed, "device": self.device, "precision": precision}
        return TextureTrainer(spec, self.targets, rate_weight=rate_weight, steps=steps, tiles=tiles, **options)

    def log_bits(self, trainer: TextureTrainer, rest: float) -> float:
        """Of all latents, as the trainer counts them, and `rest`."""
        texels = int(padded_sizes(trainer.spec).prod(1).sum())
        return log(CODED * trainer.bits * texels + rest)

    def log_coded(self, trainer: TextureTrainer, less: float) -> float:
        """Of the file less what it surely holds beside latents."""
        return log(max(coded_bits(trainer.state(self.maps)) - less, 1.0))

    def estimated_psnr(self, trainer: TextureTrainer) -> float:
        """Of the levels that are trained, in dB."""
        return -10 * log10(max(trainer.loss, 1e-12))

    def psnr(self, trainer: TextureTrainer) -> float:
        """Of mip 0, in dB."""
        return psnr(self.levels[0], Decoder(trainer.state(self.maps), self.device).decode())


def compress(
    source: Any,
    *,
    bpp: float | None = None,
    psnr: float | None = None,
    size: int | None = None,
    quality: Literal["low", "medium", "high"] | None = None,
    preview: bool = False,
    mips: int | None = None,
    weights: Mapping[str, float] | None = None,
    device: wp.DeviceLike = None,
    seed: int = 0,
    checkpoint: Path | None = None,
    quiet: bool = False,
) -> Texture:
    """A material's maps in a few quantised latent textures and one tiny network.

    source: what `load_set` takes, a folder, files, arrays or a `Material`, or a `TextureSet`. At most one goal: bpp,
    bits a texel of mip 0 with everything counted; size, in bytes, of the file; psnr, in dB, of mip 0, all channels
    together; or a quality, "medium" if nothing is said. Sizes are met within 3 %, PSNR within 0.1 dB. preview: fewer
    steps. mips: levels in the file, those of the source if None. weights: of the errors of maps, by name; 1 if not
    given. checkpoint: a file to save the long run to, every 30 seconds and at Ctrl-C; if it is there, to go on from.

    Raises `InputError` for goals that cannot be met.
    """
    begin = time.perf_counter()
    texture_set = load_set(source)
    job = _job(texture_set, mips, weights, find_device(device), seed)
    effort = effort_of(job.device, preview)
    goal, bits = _goal(job, bpp, psnr, size, quality)
    given = {"bpp": bpp, "psnr": psnr, "size": size, "quality": quality}
    kept = Checkpoint(checkpoint, job.configuration | given | {"effort": list(vars(effort).values())})
    if goal is None:
        weight = QUALITIES[quality or "medium"]
        trainer = job.trainer(job.spec(bits), precision_for(weight), effort.steps, effort.tiles, weight)
        with kept.kept(trainer, None) as watch:
            trainer.run(quiet=quiet, watch=watch)
    else:
        trainer = _search(job, goal, bits, effort, kept, quiet)
    state = trainer.state(job.maps)
    texture = Texture(state, job.device)
    errors = _errors(texture, job)
    extra = errors | {"seconds": round(time.perf_counter() - begin, 3), "steps": trainer.steps}
    return texture.with_metrics(extra | {"rate_weight": float(f"{trainer.rate_weight:.4g}")})


def _search(job: Job, goal: Goal, bits: float, effort: Effort, kept: Checkpoint, quiet: bool) -> TextureTrainer:
    fixed = job.spec(bits), precision_for(weight_for(bits))
    short, long = (partial(job.trainer, *fixed, steps, effort.tiles) for steps in (effort.probe, effort.steps))
    weight, slope = kept.plan or find(short, weight_for(bits), goal, effort.probes, quiet=quiet)
    trainer = long(weight)
    with kept.kept(trainer, [weight, slope]) as watch:
        meet(trainer, goal, slope, quiet=quiet, watch=watch)
    return trainer


def _job(
    texture_set: TextureSet, mips: int | None, weights: Mapping[str, float] | None, device: wp.Device, seed: int
) -> Job:
    levels = mip_chain(texture_set, mips or len(texture_set.levels))
    names = [each.name for each in texture_set.maps]
    for name, value in (weights or {}).items():
        require(name in names, "weights", name, f"names of maps, {', '.join(names)}")
        require(is_finite(value) and value >= 0, f"weights: {name}", value, "a finite number, not negative")
    by_channel = [(weights or {}).get(each.name, 1.0) for each in texture_set.maps for _ in each.trained]
    targets = without_hidden(levels, texture_set.maps)
    return Job(texture_set.maps, tuple(levels), targets, tuple(by_channel) if weights else (), device, seed)


def _goal(
    job: Job, bpp: float | None, psnr: float | None, size: int | None, quality: str | None
) -> tuple[Goal | None, float]:
    """And about how many bits a texel it takes."""
    given = {"bpp": bpp, "psnr": psnr, "size": size, "quality": quality}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(f"{' and '.join(named)}: each chooses how good and how large it is; give one of them")
    if quality is not None:
        require(quality in QUALITIES, "quality", quality, f"one of {', '.join(QUALITIES)}")
    for name in ("bpp", "psnr", "size"):
        value = given[name]
        if value is not None:
            require(is_finite(value) and value > 0, name, value, "a positive number")
    if psnr is not None:
        return Goal(job.estimated_psnr, job.psnr, psnr, PSNR_SLOPE, PSNR_TOLERANCE), 1.5 if psnr < 29 else 3.0
    if bpp is None and size is None:
        return None, {"low": 1.0}.get(quality, 4.0)
    bits = bpp if bpp is not None else 8 * size / job.texels
    beside = beside_latents(job.spec(bits), precision_for(weight_for(bits)))
    latents = bits * job.texels - beside
    if latents < beside / 8:
        least = 1.25 * beside
        raise InputError(
            f"{named[0]} {given[named[0]]:g}: the network alone takes {beside / 8e3:.1f} kB; give at least "
            f"{f'{least / job.texels:.3g}' if size is None else f'{least / 8:.0f} bytes'}, or fewer, larger textures"
        )
    less, rest = SURE * beside, (1 - SURE) * beside
    tolerance = BITS_TOLERANCE * bits * job.texels / (latents + rest)
    measures = partial(job.log_bits, rest=rest), partial(job.log_coded, less=less)
    return Goal(*measures, log(latents + rest), BITS_SLOPE, tolerance), bits


def _errors(texture: Texture, job: Job) -> dict[str, Any]:
    """Of mip 0 by map, and the PSNR of each mip."""
    results = [texture.decoder.decode(mip) for mip in range(len(job.levels))]
    errors = channel_errors(job.levels[0], results[0], job.maps)
    return errors | {"psnr_of_mips": [psnr(a, b) for a, b in zip(job.levels, results, strict=True)]}
