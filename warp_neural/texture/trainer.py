"""`TextureTrainer`: latents, kernels and network of a neural texture, trained on the device alone."""

import sys
from collections.abc import Sequence

import numpy as np
import warp as wp
from tqdm import tqdm

from warp_neural.kernels.coopvec.layout import bias_is_half, make_pack_kernel
from warp_neural.kernels.nn.activations import elu
from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.texture.layout import BILINEAR, Layout
from warp_neural.kernels.texture.levels import TILE, TextureData
from warp_neural.kernels.texture.sample import known_l2, make_sample
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.kernels.texture.update import kernels_kernel, round_kernel
from warp_neural.nn.mlp import MLP
from warp_neural.texture.batch import TextureBatch
from warp_neural.texture.levels import all_tiles, first_latents, make_levels, split_latents, tile_order
from warp_neural.texture.schedule import make_schedule
from warp_neural.texture.state import Map, Tensor, TextureState
from warp_neural.train.cpu_steps import FusedCpu
from warp_neural.train.optim import Adam
from warp_neural.train.progress import make_progress, make_update
from warp_neural.train.steps import FusedCuda

CHECK = 32  # steps that are one launch of a CUDA graph
HISTORY = 1 << 14  # steps whose bits are kept
START = 0.3  # of kernels: standard deviation around bilinear interpolation, times BILINEAR


class TextureTrainer:
    """levels: the trained channels of each mip, float32 [height, width, channels], NaN where any value will do.

    rate_weight: lambda, the mean squared error that a bit a texel is worth. Of a step: `tiles` squares of 32 x 32
    texels. latent_rate, network_rate: of Adam at the start. precision: steps of the file's weights, rms / precision.
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
        network_rate: float = 5e-3,
        precision: float = 16.0,
        weights: Sequence[float] = (),
        seed: int = 0,
        device: wp.DeviceLike = None,
    ):
        self.spec, self.device, self.steps = spec, wp.get_device(device), steps
        self.precision, self.layout, self.index = precision, Layout(spec), 0
        self.tiles = min(tiles, all_tiles(spec))
        random = np.random.default_rng(seed)
        self.schedule = schedule = make_schedule(steps)
        self.net = self._network(levels, random, seed)
        self.data = self._data(levels, random, rate_weight, latent_rate)
        self._kernels(random)
        optimizer = Adam(self.net.master, lr=network_rate * schedule.network, beta1=0.9, beta2=0.99)
        sizes = np.array([self.tiles * TILE * TILE])
        on_cuda = self.device.is_cuda
        self.progress = make_progress(optimizer, sizes, 128.0 if on_cuda else 1.0, seed)
        options = make_update(optimizer, self.net.master.size, 1, None, on_cuda)
        self.batch = TextureBatch(spec, self.tiles, self.device)
        sample = make_sample(spec, self.tiles, self.net.vec_in)
        loss: Loss = known_l2.weighted(*weights) if weights else known_l2
        kind = FusedCuda if on_cuda else FusedCpu
        self.launches = kind(
            self.net, optimizer, self.progress, options, sample, self.data, loss, sizes, encoded_batch=self.batch
        )
        self.graphs: dict[tuple[int, bool], object] = {}

    def _network(self, levels: Sequence[np.ndarray], random: np.random.Generator, seed: int) -> MLP:
        """He initialisation, the last layer smaller, its biases the channels' means."""
        spec = self.spec
        width, depth = spec.hidden[0], len(spec.hidden)
        net = MLP(spec.n_in, spec.channels, width, depth, activation=elu, device=self.device, seed=seed)
        last = len(spec.layers) - 1
        gains = [np.sqrt(2 / n_in) * (0.3 if l == last else 1) for l, (_, n_in) in enumerate(spec.layers)]
        net.weights = [
            g * random.standard_normal(s).astype(np.float32) for g, s in zip(gains, spec.layers, strict=True)
        ]
        biases = net.biases
        biases[-1] = np.nan_to_num(np.nanmean(levels[0], (0, 1))).astype(np.float32)
        net.biases = biases
        return net

    def _data(
        self, levels: Sequence[np.ndarray], random: np.random.Generator, rate_weight: float, latent_rate: float
    ) -> TextureData:
        spec, schedule, device = self.spec, self.schedule, self.device
        data, n = TextureData(), int(first_latents(spec)[-1])
        data.levels = make_levels(spec, device)
        data.tiles = wp.array(tile_order(spec, self.steps * self.tiles, random), dtype=wp.vec3i, device=device)
        targets = np.concatenate([level.reshape(-1, spec.channels) for level in levels])
        data.targets = wp.array(targets, dtype=float, device=device)
        data.latents = wp.array(random.standard_normal(n, np.float32), dtype=float, device=device)
        for name in ("gradient", "first", "second"):
            setattr(data, name, wp.zeros(n, dtype=float, device=device))
        for name in ("kernels", "kernels_gradient"):
            setattr(data, name, wp.zeros(self.layout.size, dtype=float, device=device))
        data.rate_weight = wp.array(rate_weight * schedule.rate, dtype=float, device=device)
        data.latent_rate = wp.array(latent_rate * schedule.latents, dtype=float, device=device)
        data.noise_until, data.latents_until = schedule.noise_until, schedule.latents_until
        channels = sum(grid.channels for grid in spec.grids)
        data.sums = wp.zeros((self.tiles, channels), dtype=wp.vec2, device=device)
        data.bits = wp.zeros(HISTORY, dtype=float, device=device)
        return data

    def _kernels(self, random: np.random.Generator) -> None:
        """Kernels and scales, and what their optimizer keeps."""
        start = np.zeros(self.layout.size, np.float32)
        for name, place in self.layout.places.items():
            if name.startswith("kernel"):
                grid = self.spec.grids[int(name.split("_")[1])]
                start[place.start : place.end] = initial_kernel(grid, place.shape, random).ravel()
        device = self.device
        self.kernels = wp.array(start, dtype=float, device=device)
        self.data.kernels.assign(self.kernels)
        self.first, self.second = (wp.zeros(self.layout.size, dtype=float, device=device) for _ in range(2))
        self.kernel_steps = wp.ones(self.layout.size, dtype=float, device=device)
        self.network_steps = wp.ones(self.net.master.size, dtype=float, device=device)
        self.rounded = wp.zeros(self.net.master.size, dtype=float, device=device)

    def run(self, steps: int | None = None, quiet: bool = False) -> None:
        """Take `steps` steps, or all that are left."""
        end = self.steps if steps is None else min(self.index + steps, self.steps)
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
        net, spec, cuda = self.net, self.net.spec, self.device.is_cuda
        arrays = [net.master, self.network_steps, self.rounded]
        wp.launch(round_kernel, net.master.size, arrays, device=self.device, record_tape=False)
        inputs = [net.table, net.steps, self.rounded, spec.n_parameters, net.packed, net.words]
        kernel = make_pack_kernel(spec.format, cuda, bias_is_half(spec, cuda))
        wp.launch(kernel, (1, net.words), inputs, device=self.device, record_tape=False)

    def _set_steps(self) -> None:
        """Of the file's integers, from now on."""
        values, steps = self.kernels.numpy(), np.ones(self.layout.size, np.float32)
        for place in self.layout.places.values():
            steps[place.start : place.end] = step_of(values[place.start : place.end], self.precision)
        self.kernel_steps.assign(steps)
        parts = []
        for w, b in zip(self.net.weights, self.net.biases, strict=True):
            parts += [np.full(w.size, step_of(w, self.precision)), np.full(b.size, step_of(b, 64.0))]
        self.network_steps.assign(np.concatenate(parts).astype(np.float32))

    def state(self, maps: tuple[Map, ...], extra: dict | None = None) -> TextureState:
        """What the file holds; after the last step."""
        spec, latents = self.spec, self.data.latents.numpy()
        latents = split_latents(spec, latents)
        rounded = tuple(
            tuple(round_latents(each, grid) for each, grid in zip(level, spec.grids, strict=True)) for level in latents
        )
        tensors, values, steps = {}, self.kernels.numpy(), self.kernel_steps.numpy()
        for name, place in self.layout.places.items():
            if name.startswith("kernel"):
                array = np.moveaxis(values[place.start : place.end].reshape(place.shape), -1, 0)
                tensors[name] = integers(array, steps[place.start])
        at, steps = 0, self.network_steps.numpy()
        for l, (w, b) in enumerate(zip(self.net.weights, self.net.biases, strict=True)):
            tensors[f"weights_{l}"] = integers(w, steps[at])
            tensors[f"biases_{l}"] = integers(b, steps[at + w.size])
            at += w.size + b.size
        return TextureState(spec, rounded, tensors, maps, extra or {})

    @property
    def loss(self) -> float:
        """Mean squared error of the last 32 steps."""
        losses = self.progress.losses.numpy()
        return float(np.mean([losses[i % HISTORY] for i in range(max(self.index - 32, 0), self.index)]))

    @property
    def bits(self) -> float:
        """A texel, by the model of the rate, in the last 32 steps."""
        bits = self.data.bits.numpy()
        steps = range(max(self.index - 32, 0), self.index)
        return float(np.mean([bits[i % HISTORY] for i in steps])) / (self.tiles * TILE * TILE)


def initial_kernel(grid: Grid, shape: tuple[int, ...], random: np.random.Generator) -> np.ndarray:
    f = (np.arange(grid.scale) + 0.5) / grid.scale
    line = np.stack([1 - f, f], -1)  # [scale, 2]
    if grid.kernel == "learned":
        bilinear = np.einsum("ya,xb->yxab", line, line).reshape(grid.scale, grid.scale, 4, 1)
        return BILINEAR * (bilinear + START * random.standard_normal(shape))
    return np.sqrt(BILINEAR) * (line[..., None] + START * random.standard_normal(shape))


def step_of(values: np.ndarray, precision: float) -> np.float32:
    """rms / precision as a float16 number."""
    rms = np.sqrt(np.mean(np.square(values, dtype=np.float64)))
    return np.float32(np.float16(max(rms, 1e-4) / precision))


def integers(values: np.ndarray, step: np.float32) -> Tensor:
    return Tensor(np.rint(values / step).astype(np.int32), float(step))


def round_latents(latents: np.ndarray, grid: Grid) -> np.ndarray:
    if grid.bits == 1:
        return np.where(latents < 0, -1, 1).astype(np.int8)
    return np.clip(np.rint(latents), -grid.limit, grid.limit).astype(np.int8)
