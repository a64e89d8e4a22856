"""What `compress` is to do: maps, mip levels and what their errors cost, and what a training run of them has led to."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log
from typing import Any, Literal, get_args
from zlib import crc32

import numpy as np
import warp as wp

from warp_neural.kernels.errors import is_finite, require
from warp_neural.kernels.texture.losses import Cost, TextureLoss, known_l2
from warp_neural.kernels.texture.spec import BlockSpec, TextureSpec
from warp_neural.texture.block_trainer import BlockTrainer
from warp_neural.texture.decoder import Decoder
from warp_neural.texture.file import coded_bits
from warp_neural.texture.latent_trainer import LatentTrainer
from warp_neural.texture.maps import TextureSet, mip_chain, without_hidden
from warp_neural.texture.measure import psnr
from warp_neural.texture.presets import BLOCK_RATE, FIXED_RATE, FIXED_SPREAD, block_spec, fixed_spec, spec_of
from warp_neural.texture.state import Map
from warp_neural.texture.trainer import TextureTrainer

Storage = Literal["load", "sample", "engine"]
"""what few bits are wanted of: the file, the latents that are read while a picture is made, or these as textures of BC1
blocks, which GPUs filter"""


@dataclass(frozen=True)
class Job:
    """What is to be compressed, and with what."""

    maps: tuple[Map, ...]
    levels: tuple[np.ndarray, ...]
    targets: list[np.ndarray]
    loss: TextureLoss
    device: wp.Device
    seed: int
    storage: Storage = "load"

    @property
    def configuration(self) -> dict[str, Any]:
        """JSON that another job has otherwise."""
        digest = 0
        for level in self.targets:
            digest = crc32(np.ascontiguousarray(level), digest)
        sizes = [list(level.shape) for level in self.levels]
        return {
            "pictures": digest,
            "sizes": sizes,
            "loss": repr(self.loss),
            "seed": self.seed,
            "storage": self.storage,
        }

    @property
    def texels(self) -> int:
        return self.levels[0].shape[0] * self.levels[0].shape[1]

    @property
    def all_texels(self) -> int:
        """Of all levels."""
        return sum(level.shape[0] * level.shape[1] for level in self.levels)

    def spec(self, bits: float) -> TextureSpec | BlockSpec:
        make = {"load": spec_of, "sample": fixed_spec, "engine": block_spec}[self.storage]
        return make(*self.levels[0].shape, len(self.levels), bits)

    def trainer(
        self, spec: TextureSpec | BlockSpec, precision: float, steps: int, tiles: int, rate_weight: float
    ) -> LatentTrainer:
        options = {"loss": self.loss, "seed": self.seed, "device": self.device, "precision": precision}
        options |= {"steps": steps, "tiles": tiles}
        if self.storage == "engine":
            return BlockTrainer(spec, self.targets, latent_rate=BLOCK_RATE, **options)
        if self.storage == "sample":
            options |= {"latent_rate": FIXED_RATE, "spread": FIXED_SPREAD}
        return TextureTrainer(spec, self.targets, rate_weight=rate_weight, **options)

    def log_coded(self, trainer: TextureTrainer, less: float) -> float:
        """Of the file less what it surely holds beside latents."""
        return log(max(coded_bits(trainer.state(self.maps)) - less, 1.0))

    def psnr(self, trainer: TextureTrainer) -> float:
        """Of mip 0, in dB."""
        return psnr(self.levels[0], Decoder(trainer.state(self.maps), self.device).decode())


def make_job(
    texture_set: TextureSet,
    mips: int | None,
    weights: Mapping[str, float] | None,
    losses: Mapping[str, Cost] | None,
    device: wp.Device,
    seed: int,
    storage: Storage = "load",
) -> Job:
    require(storage in get_args(Storage), "storage", storage, f"one of {', '.join(get_args(Storage))}")
    levels = mip_chain(texture_set, mips or len(texture_set.levels))
    loss = loss_of(texture_set.maps, weights, losses)
    targets = without_hidden(levels, texture_set.maps)
    return Job(texture_set.maps, tuple(levels), targets, loss, device, seed, storage)


def loss_of(
    maps: tuple[Map, ...], weights: Mapping[str, float] | None, losses: Mapping[str, Cost] | None
) -> TextureLoss:
    """By the names of maps; 1 and "l2" where nothing is given."""
    weights, losses, names = weights or {}, losses or {}, [each.name for each in maps]
    for what, given in (("weights", weights), ("losses", losses)):
        for name in given:
            require(name in names, what, name, f"names of maps, {', '.join(names)}")
    for name, value in weights.items():
        require(is_finite(value) and value >= 0, f"weights: {name}", value, "a finite number, not negative")
    places = np.cumsum([0, *(len(each.trained) for each in maps)]).tolist()
    normals, colours = [], []
    for name, cost in losses.items():
        each, place = maps[names.index(name)], places[names.index(name)]
        require(cost in get_args(Cost), f"losses: {name}", cost, f"one of {', '.join(get_args(Cost))}")
        if cost == "angle":
            fits = each.kind == "normal" and each.trained[:3] == (0, 1, 2)
            require(fits, f"losses: {name}", cost, "l2 for what is no normal of three channels")
            normals.append(place)
        if cost == "luminance":
            fits = each.kind != "normal" and each.trained[:3] == (0, 1, 2)
            require(fits, f"losses: {name}", cost, "l2 for what has no three channels of colour that vary")
            colours.append(place)
    by_channel = [weights.get(each.name, 1.0) for each in maps for _ in each.trained]
    loss = known_l2.weighted(*by_channel) if weights else known_l2
    return replace(loss, normals=tuple(normals), colours=tuple(colours))
