"""Training that can be stopped and gone on with: what commands wrap around `Trainer.run`."""

import time
from typing import Any

import warp as wp

from warp_neural.cli.options import TrainingConfig
from warp_neural.errors import InputError
from warp_neural.train.trainer import Trainer


def train(trainer: Trainer, steps: int, config: TrainingConfig, name: str = "network") -> float:
    """`trainer.run` up to step `steps`, with a bar; returns the seconds but for the first step, which compiles.

    The checkpoint `name` is written every 30 seconds, at the end, and on Ctrl-C; with `--resume` it goes on from there.
    """
    path = config.checkpoints / f"{name}.safetensors"
    if config.resume and path.is_file():
        trainer.load(path)
    try:
        trainer.run(min(steps - trainer.index, 1), quiet=True)
        began = time.perf_counter()
        trainer.run(steps - trainer.index, checkpoint=path, quiet=config.json)
        wp.synchronize_device(trainer.device)
    except KeyboardInterrupt:
        trainer.save(path)
        raise
    return time.perf_counter() - began


def check_resume(config: Any) -> None:
    if getattr(config, "resume", False) and not any(config.checkpoints.glob("*.safetensors")):
        folder = config.checkpoints.parent
        raise InputError(f"--resume: {folder} has no checkpoints of a run that was stopped; leave it out")
