"""`TextureTrainer`: grids of latents, the kernels that read them and a network."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from warp_neural.kernels.texture.layout import Layout
from warp_neural.kernels.texture.levels import TILE
from warp_neural.kernels.texture.spec import TextureSpec
from warp_neural.kernels.texture.update import kernels_kernel
from warp_neural.texture.batch import Batch, GridLaunches
from warp_neural.texture.initial import initial_kernels
from warp_neural.texture.latent_trainer import LatentTrainer
from warp_neural.texture.levels import first_latents
from warp_neural.texture.rounding import kernel_steps, rounded_latents, tensors_of
from warp_neural.texture.state import Map, TextureState
from warp_neural.train.progress import HISTORY

INITIAL = 0.1  # deviation of latents at the start: at 1, runs of 50 passes over a texture end with 1.5 times the bits


class TextureTrainer(LatentTrainer):
    """rate_weight: lambda, the mean squared error that a bit a texel is worth, which may be set anew; or 0, for latents
    that take as many bits as their grids say. spread: deviation of latents at the start, of half of their range, or
    None for `INITIAL`. The rest: as `LatentTrainer` has it.
    """

    def __init__(
        self,
        spec: TextureSpec,
        levels: Sequence[np.ndarray],
        *,
        rate_weight: float,
        spread: float | None = None,
        **options: Any,
    ):
        self.layout, self.spread, self._rate_weight = Layout(spec), spread, rate_weight
        super().__init__(spec, levels, **options)

    def _make_latents(self, random: np.random.Generator) -> Batch:
        data, spec, n = self.data, self.spec, int(first_latents(self.spec)[-1])
        data.latents = self._array(self._deviations() * random.standard_normal(n, np.float32))
        for name in ("gradient", "first", "second"):
            setattr(data, name, self._array(np.zeros(n)))
        kernels = initial_kernels(self.layout, random)
        self.kernels, data.kernels = self._array(kernels), self._array(kernels)
        self.first, self.second, data.kernels_gradient = (self._array(np.zeros(self.layout.size)) for _ in range(3))
        self.kernel_steps = self._array(np.ones(self.layout.size))
        data.rate_weight = self._array(self.rate_weight * self.schedule.rate)
        channels = sum(grid.channels for grid in spec.grids)
        data.sums = wp.zeros((self.tiles, channels), dtype=wp.vec2, device=self.device)
        data.bits = self._array(np.zeros(HISTORY))

        def make(g: int, encoded: wp.array) -> GridLaunches:
            return GridLaunches(spec, g, self.tiles, encoded, rated=self.rate_weight > 0)

        return Batch(spec, self.tiles, self.device, make, len(spec.grids))

    def _deviations(self) -> np.ndarray:
        """Of each latent at the start."""
        sizes, spread = np.diff(first_latents(self.spec)), self.spread
        by_grid = [INITIAL if spread is None else spread * (grid.limit + 0.5) for grid in self.spec.grids]
        return np.tile(np.float32(by_grid), self.spec.mips).repeat(sizes)

    @property
    def rate_weight(self) -> float:
        return self._rate_weight

    @rate_weight.setter
    def rate_weight(self, value: float) -> None:
        self._rate_weight = value  # 0 only from the start
        self.data.rate_weight.assign((value * self.schedule.rate).astype(np.float32))

    def _move_latents(self) -> None:
        arguments = [self.progress, self.data, self.layout.kernels_end, self.kernel_steps]
        arguments += [self.kernels, self.first, self.second]
        wp.launch(kernels_kernel, self.layout.size, arguments, device=self.device, record_tape=False)
        super()._move_latents()

    def _set_steps(self) -> None:
        super()._set_steps()
        self.kernel_steps.assign(kernel_steps(self.layout, self.kernels.numpy(), self.precision))

    def state(self, maps: tuple[Map, ...], extra: Mapping[str, Any] | None = None) -> TextureState:
        """What a file holds. Before latents rest, rounded as it would be then."""
        if self.index <= self.schedule.latents_until:
            self._set_steps()
        latents = rounded_latents(self.spec, self.data.latents.numpy())
        kernels = self.kernels.numpy(), self.kernel_steps.numpy()
        tensors = tensors_of(self.layout, *kernels, self.net, self.network_steps.numpy())
        return TextureState(self.spec, latents, tensors, maps, extra or {})

    def _latent_arrays(self) -> dict[str, wp.array]:
        arrays = {f"latents_{name}": getattr(self.data, name) for name in ("latents", "first", "second")}
        arrays |= {"used": self.data.kernels, "kernels": self.kernels, "first": self.first, "second": self.second}
        return arrays | {"kernel_steps": self.kernel_steps, "bits": self.data.bits}

    @property
    def bits(self) -> float:
        """A texel of any level, by the model of the rate, in the last steps."""
        return self._mean(self.data.bits) / (self.tiles * TILE * TILE)
