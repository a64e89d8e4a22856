"""A long run's checkpoint: written while it runs and when it is stopped, from where another goes on."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from warp_neural.errors import InputError
from warp_neural.io.tensors import load_tensors, save_tensors
from warp_neural.texture.latent_trainer import LatentTrainer

SAVE_SECONDS = 30
FORMAT, VERSION = "texture checkpoint", 1


class Checkpoint:
    """path: of the file, or None for a run that keeps none. configuration: JSON, what has to be the same for a run to
    go on.

    Raises `InputError` for a file that is damaged or of another run.
    """

    def __init__(self, path: Path | None, configuration: dict[str, Any]):
        self.path, self.configuration = path, configuration
        self.tensors: dict[str, np.ndarray] | None = None
        if path and path.is_file():
            self.tensors, metadata = load_tensors(path)
            if (metadata.get("format"), metadata.get("version")) != (FORMAT, VERSION):
                raise InputError(f"{path}: not a checkpoint of compress; leave --resume out")
            if metadata.get("configuration") != configuration:
                raise InputError(f"{path}: of other pictures or options; give the same ones, or leave --resume out")
            self.rate_weight = metadata.get("rate_weight")

    @contextmanager
    def kept(self, trainer: LatentTrainer) -> Iterator[Callable[[], None] | None]:
        """Takes the trainer to where the file was, if there is one, once; yields what saves now and then."""
        if self.tensors is not None:
            self._restore(trainer)
        if self.path is None:
            yield None
            return
        saved = time.monotonic()

        def watch() -> None:
            nonlocal saved
            if time.monotonic() - saved > SAVE_SECONDS:
                self.save(trainer)
                saved = time.monotonic()

        try:
            yield watch
        except KeyboardInterrupt:
            self.save(trainer)
            raise

    def save(self, trainer: LatentTrainer) -> None:
        metadata = {"format": FORMAT, "version": VERSION, "configuration": self.configuration}
        save_tensors(self.path, trainer.snapshot(), metadata | {"rate_weight": trainer.rate_weight})

    def _restore(self, trainer: LatentTrainer) -> None:
        for name, array in trainer.arrays.items():
            tensor = self.tensors.get(name)
            if tensor is None or tensor.shape != array.numpy().shape or tensor.dtype != array.numpy().dtype:
                raise InputError(f"{self.path}: tensor {name!r} is missing or of another size; leave --resume out")
        trainer.restore(self.tensors)
        trainer.rate_weight = self.rate_weight
        self.tensors = None
