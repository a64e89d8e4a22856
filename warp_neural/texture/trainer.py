"""`TextureTrainer`: latents, kernels and network of a neural texture, trained on the device alone."""

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from tqdm import tqdm

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.texture.layout import Layout
from warp_neural.kernels.texture.levels import TILE, TextureData
from warp_neural.kernels.texture.losses import TextureLoss, known_l2
from warp_neural.kernels.texture.sample import make_sample
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.texture.update import kernels_kernel, round_kernel
from warp_neural.texture.batch import TextureBatch
from warp_neural.texture.initial import initial_kernels, initial_network, set_means
from warp_neural.texture.levels import all_tiles, first_latents, make_levels, tile_order
from warp_neural.texture.rounding import kernel_steps, network_steps, rounded_latents, tensors_of
from warp_neural.texture.schedule import make_schedule
from warp_neural.texture.state import Map, TextureState
from warp_neural.train.cpu_steps import FusedCpu
from warp_neural.train.optim import Adam
from warp_neural.train.progress import HISTORY, make_progress, make_update
from warp_neural.train.steps import FusedCuda

CHECK = 32  # steps that are one launch of a CUDA graph
INITIAL = 0.1  # deviation of latents at the start: at 1, runs of 50 passes over a texture end with 1.5 times the bits
WINDOW = 128  # steps whose mean loss and bits are told


class TextureTrainer:
    """levels: the trained channels of each mip, float32 [height, width, channels], NaN where any value will do; then
    the weights that `loss` takes.

    rate_weight: lambda, the mean squared error that a bit a texel is worth, which may be set anew; or 0, for latents
    that take as many bits as their grids say. Of a step: `tiles` squares of 32 x 32 texels. latent_rate, network_rate:
    of Adam at the start. spread: deviation of latents at the start, of half of their range, or None for `INITIAL`.
    precision: of the file's weights, whose steps are rms / precision. loss: what errors cost.
    """

    def __init__(
        self,
        spec: TextureSpec,
        levels: Sequence[np.ndarray],
        *,
        rate_weight: float,
        steps: int,
        tiles: int = 64,
        latent_rate: float = 0.3,
        spread: float | None = None,
        network_rate: float = 5e-3,
        precision: float = 16.0,
        loss: TextureLoss = known_l2,
        seed: int = 0,
        device: wp.DeviceLike = None,
    ):
        self.spec, self.device, self.steps = spec, find_device(device), steps
        self.precision, self.layout, self.index = precision, Layout(spec), 0
        self.tiles = min(tiles, all_tiles(spec))
        random = np.random.default_rng(seed)
        self.schedule = make_schedule(steps)
        self.net = initial_network(spec, self.device, random)
        set_means(self.net, levels)
        self.data = self._data(levels, random, latent_rate, spread)
        self.rate_weight = rate_weight
        self.kernels = self._array(initial_kernels(self.layout, random))
        self.data.kernels.assign(self.kernels)
        self.first, self.second = (self._array(np.zeros(self.layout.size)) for _ in range(2))
        self.kernel_steps = self._array(np.ones(self.layout.size))
        self.network_steps, self.rounded = (self._array(np.ones(self.net.master.size)) for _ in range(2))
        self._launches(network_rate, loss, seed)
        self.graphs: dict[bool, Any] = {}

    def _array(self, values: np.ndarray) -> wp.array:
        return wp.array(values, dtype=float, device=self.device)

    def _data(
        self, levels: Sequence[np.ndarray], random: np.random.Generator, latent_rate: float, spread: float | None
    ) -> TextureData:
        spec, schedule, device = self.spec, self.schedule, self.device
        data, n = TextureData(), int(first_latents(spec)[-1])
        data.levels = make_levels(spec, device)
        data.tiles = wp.array(tile_order(spec, self.steps * self.tiles, random), dtype=wp.vec3i, device=device)
        data.targets = self._array(np.concatenate([level.reshape(-1, level.shape[-1]) for level in levels]))
        data.latents = self._array(self._deviations(spread) * random.standard_normal(n, np.float32))
        for name in ("gradient", "first", "second"):
            setattr(data, name, wp.zeros(n, dtype=float, device=device))
        for name in ("kernels", "kernels_gradient"):
            setattr(data, name, wp.zeros(self.layout.size, dtype=float, device=device))
        data.latent_rate = self._array(latent_rate * schedule.latents)
        data.rate_weight = self._array(schedule.rate)
        data.noise_until, data.latents_until = schedule.noise_until, schedule.latents_until
        channels = sum(grid.channels for grid in spec.grids)
        data.sums = wp.zeros((self.tiles, channels), dtype=wp.vec2, device=device)
        data.bits = wp.zeros(HISTORY, dtype=float, device=device)
        return data

    def _deviations(self, spread: float | None) -> np.ndarray:
        """Of each latent at the start."""
        sizes = np.diff(first_latents(self.spec))
        by_grid = [INITIAL if spread is None else spread * (grid.limit + 0.5) for grid in self.spec.grids]
        return np.tile(np.float32(by_grid), self.spec.mips).repeat(sizes)

    def _launches(self, network_rate: float, loss: TextureLoss, seed: int) -> None:
        net, on_cuda = self.net, self.device.is_cuda
        self.optimizer = Adam(net.master, lr=network_rate * self.schedule.network, beta1=0.9, beta2=0.99)
        sizes = np.array([self.tiles * TILE * TILE])
        self.progress = make_progress(self.optimizer, sizes, 128.0 if on_cuda else 1.0, seed)
        options = make_update(self.optimizer, net.master.size, 1, None, on_cuda)
        self.batch = TextureBatch(self.spec, self.tiles, self.device, rated=self.rate_weight > 0)
        sample = make_sample(self.spec, self.tiles, net.vec_in)
        kind = FusedCuda if on_cuda else FusedCpu
        common = net, self.optimizer, self.progress, options
        self.launches = kind(*common, sample, self.data, loss, sizes, encoded_batch=self.batch)

    @property
    def rate_weight(self) -> float:
        return self._rate_weight

    @rate_weight.setter
    def rate_weight(self, value: float) -> None:
        self._rate_weight = value  # 0 only from the start
        self.data.rate_weight.assign((value * self.schedule.rate).astype(np.float32))

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
        arguments = [self.progress, self.data, self.layout.kernels_end, self.kernel_steps]
        arguments += [self.kernels, self.first, self.second]
        wp.launch(kernels_kernel, self.layout.size, arguments, device=self.device, record_tape=False)
        if alone:
            self._pack_rounded()
        self.batch.update(self.progress, self.data, self.tiles / all_tiles(self.spec))

    def _pack_rounded(self) -> None:
        """The network's weights as the file will have them, to what its kernels read."""
        net = self.net
        arrays = [net.master, self.network_steps, self.rounded]
        wp.launch(round_kernel, net.master.size, arrays, device=self.device, record_tape=False)
        net.pack(self.rounded)

    def _set_steps(self) -> None:
        """Of the file's integers, from now on."""
        self.kernel_steps.assign(kernel_steps(self.layout, self.kernels.numpy(), self.precision))
        self.network_steps.assign(network_steps(self.net, self.precision))

    def state(self, maps: tuple[Map, ...], extra: Mapping[str, Any] | None = None) -> TextureState:
        """What a file holds. Before latents rest, rounded as it would be then."""
        if self.index <= self.schedule.latents_until:
            self._set_steps()
        latents = rounded_latents(self.spec, self.data.latents.numpy())
        kernels = self.kernels.numpy(), self.kernel_steps.numpy()
        tensors = tensors_of(self.layout, *kernels, self.net, self.network_steps.numpy())
        return TextureState(self.spec, latents, tensors, maps, extra or {})

    @property
    def arrays(self) -> dict[str, wp.array]:
        """All that changes from step to step."""
        arrays = {name: getattr(self.progress, name) for name in ("counters", "flags", "skipped", "good", "scale")}
        arrays |= {f"latents_{name}": getattr(self.data, name) for name in ("latents", "first", "second")}
        arrays |= {"used": self.data.kernels, "kernels": self.kernels, "first": self.first, "second": self.second}
        arrays |= {"network": self.net.master, "moment": self.optimizer.first, "square": self.optimizer.second}
        arrays |= {"kernel_steps": self.kernel_steps, "network_steps": self.network_steps}
        return arrays | {"losses": self.progress.losses, "bits": self.data.bits}

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

    @property
    def bits(self) -> float:
        """A texel of any level, by the model of the rate, in the last steps."""
        return self._mean(self.data.bits) / (self.tiles * TILE * TILE)

    def _mean(self, history: wp.array) -> float:
        last = np.arange(max(self.index - WINDOW, 0), self.index) % HISTORY
        return float(history.numpy()[last].mean()) if len(last) else float("nan")
