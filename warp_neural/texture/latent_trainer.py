"""`LatentTrainer`: latents of any kind and a network, trained on the device alone."""

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from tqdm import tqdm

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.texture.levels import TILE, TextureData
from warp_neural.kernels.texture.losses import TextureLoss, known_l2
from warp_neural.kernels.texture.sample import make_sample
from warp_neural.kernels.texture.spec import BlockSpec, TextureSpec
from warp_neural.kernels.texture.update import round_kernel
from warp_neural.texture.batch import Batch
from warp_neural.texture.initial import initial_network, set_means
from warp_neural.texture.levels import all_tiles, make_levels, tile_order
from warp_neural.texture.rounding import network_steps
from warp_neural.texture.schedule import make_schedule
from warp_neural.train.cpu_steps import FusedCpu
from warp_neural.train.optim import Adam
from warp_neural.train.progress import HISTORY, make_progress, make_update
from warp_neural.train.steps import FusedCuda

CHECK = 32  # steps that are one launch of a CUDA graph
WINDOW = 128  # steps whose mean loss and bits are told


class LatentTrainer(ABC):
    """levels: the trained channels of each mip, float32 [height, width, channels], NaN where any value will do; then
    the weights that `loss` takes.

    Of a step: `tiles` squares of 32 x 32 texels. latent_rate, network_rate: of Adam at the start. precision: of the
    file's weights, whose steps are rms / precision. loss: what errors cost. What latents are, subclasses say.
    """

    rate_weight = 0.0
    """lambda, the mean squared error that a bit a texel is worth; 0 for latents of fixed size"""

    def __init__(
        self,
        spec: TextureSpec | BlockSpec,
        levels: Sequence[np.ndarray],
        *,
        steps: int,
        tiles: int = 64,
        latent_rate: float = 0.3,
        network_rate: float = 5e-3,
        precision: float = 16.0,
        loss: TextureLoss = known_l2,
        seed: int = 0,
        device: wp.DeviceLike = None,
    ):
        self.spec, self.device, self.steps = spec, find_device(device), steps
        self.precision, self.index = precision, 0
        self.tiles = min(tiles, all_tiles(spec))
        random = np.random.default_rng(seed)
        self.schedule = make_schedule(steps)
        self.net = initial_network(spec, self.device, random)
        set_means(self.net, levels)
        self.data = self._data(levels, latent_rate, random)
        self.batch = self._make_latents(random)
        self.network_steps, self.rounded = (self._array(np.ones(self.net.master.size)) for _ in range(2))
        self._launches(network_rate, loss, seed)
        self.graphs: dict[bool, Any] = {}

    def _array(self, values: np.ndarray) -> wp.array:
        return wp.array(values, dtype=float, device=self.device)

    def _data(self, levels: Sequence[np.ndarray], latent_rate: float, random: np.random.Generator) -> TextureData:
        """What is the same for all latents."""
        spec, schedule = self.spec, self.schedule
        data = TextureData()
        data.levels = make_levels(spec, self.device)
        order = tile_order(spec, self.steps * self.tiles, random)
        data.tiles = wp.array(order, dtype=wp.vec3i, device=self.device)
        data.targets = self._array(np.concatenate([level.reshape(-1, level.shape[-1]) for level in levels]))
        data.latent_rate = self._array(latent_rate * schedule.latents)
        data.noise_until, data.latents_until = schedule.noise_until, schedule.latents_until
        return data

    @abstractmethod
    def _make_latents(self, random: np.random.Generator) -> Batch:
        """The rest of `data`; returns what makes the network's inputs of it."""

    @abstractmethod
    def _latent_arrays(self) -> dict[str, wp.array]:
        """All of latents that changes from step to step."""

    def _move_latents(self) -> None:
        """A step of their optimizer."""
        self.batch.update(self.progress, self.data, self.tiles / all_tiles(self.spec))

    def _launches(self, network_rate: float, loss: TextureLoss, seed: int) -> None:
        net, on_cuda = self.net, self.device.is_cuda
        self.optimizer = Adam(net.master, lr=network_rate * self.schedule.network, beta1=0.9, beta2=0.99)
        sizes = np.array([self.tiles * TILE * TILE])
        self.progress = make_progress(self.optimizer, sizes, 128.0 if on_cuda else 1.0, seed)
        options = make_update(self.optimizer, net.master.size, 1, None, on_cuda)
        sample = make_sample(self.spec, self.tiles, net.vec_in)
        kind = FusedCuda if on_cuda else FusedCpu
        common = net, self.optimizer, self.progress, options
        self.launches = kind(*common, sample, self.data, loss, sizes, encoded_batch=self.batch)

    def run(self, end: int | None = None, quiet: bool = True, watch: Callable[[], None] | None = None) -> None:
        """Take all steps before step `end`, or all. watch: called now and then."""
        end = self.steps if end is None else min(end, self.steps)
        with tqdm(total=end - self.index, disable=True if quiet else None, file=sys.stderr, unit="step") as bar:
            while self.index < end:
                if self.index == self.schedule.latents_until:
                    self._set_steps()
                alone = self.index >= self.schedule.latents_until
                boundary = self.steps if alone else self.schedule.latents_until
                count = min(CHECK, end - self.index, boundary - self.index)
                self._launch(count, alone)
                self.index += count
                bar.update(count)
                if watch:
                    watch()
        self._check()

    def _check(self) -> None:
        if self.progress.good.numpy()[self.index % 2] <= -CHECK:
            raise InputError(
                f"training stopped at step {self.index}: no gradient was finite for {CHECK} steps; lower latent_rate "
                "or network_rate"
            )

    def _launch(self, count: int, alone: bool) -> None:
        if not self.device.is_cuda or count < CHECK:
            for _ in range(count):
                self._step(alone)
            return
        if alone not in self.graphs:
            with wp.ScopedCapture(self.device) as capture:
                for _ in range(count):
                    self._step(alone)
            self.graphs[alone] = capture.graph
        wp.capture_launch(self.graphs[alone])

    def _step(self, alone: bool) -> None:
        """alone: latents rest, and weights are rounded."""
        self.launches.gradient(0)
        self.launches.update()
        self._move_latents()
        if alone:
            self._pack_rounded()

    def _pack_rounded(self) -> None:
        """The network's weights as the file will have them, to what its kernels read."""
        net = self.net
        arrays = [net.master, self.network_steps, self.rounded]
        wp.launch(round_kernel, net.master.size, arrays, device=self.device, record_tape=False)
        net.pack(self.rounded)

    def _set_steps(self) -> None:
        """Of the file's integers, from now on."""
        self.network_steps.assign(network_steps(self.net, self.precision))

    @property
    def arrays(self) -> dict[str, wp.array]:
        """All that changes from step to step."""
        arrays = {name: getattr(self.progress, name) for name in ("counters", "flags", "skipped", "good", "scale")}
        arrays |= {"network": self.net.master, "moment": self.optimizer.first, "square": self.optimizer.second}
        arrays |= {"network_steps": self.network_steps, "losses": self.progress.losses}
        return arrays | self._latent_arrays()

    def snapshot(self) -> dict[str, np.ndarray]:
        """Copies of `arrays`, on the host."""
        return {name: array.numpy().copy() for name, array in self.arrays.items()}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Go on from a snapshot."""
        for name, array in self.arrays.items():
            array.assign(arrays[name])
        self.index = int(self.progress.counters.numpy()[0])
        self.net.pack()
        if self.index > self.schedule.latents_until:
            self._pack_rounded()

    @property
    def loss(self) -> float:
        """What errors cost in the last steps, in the mean."""
        return self._mean(self.progress.losses)

    def _mean(self, history: wp.array) -> float:
        last = np.arange(max(self.index - WINDOW, 0), self.index) % HISTORY
        return float(history.numpy()[last].mean()) if len(last) else float("nan")
