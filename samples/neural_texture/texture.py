"""What a neural texture consists of, on a device, and what it takes in a file: the same in every step.

Sizes, names, the rounding of weights and the decoder are those of the package's codec, `warp_neural.texture`.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_neural.kernels.texture.layout import BILINEAR
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture import numbers
from warp_neural.texture.decoder import Decoder
from warp_neural.texture.initial import initial_network, set_means
from warp_neural.texture.levels import split_latents
from warp_neural.texture.maps import TextureSet
from warp_neural.texture.measure import psnr
from warp_neural.texture.rounding import BIASES, integers, step_of
from warp_neural.texture.state import Tensor, TextureState
from warp_neural.train.optim import Parameters

WIDTH = 32  # neurons of each of two hidden layers
PRECISION = 32.0  # weights are rounded to 1/32 of their root mean square


class Texture:
    """latents: a `wp.vec4` for each four channels of a cell, cell after cell, grid after grid. read: what the network
    sees of them in a training step; its gradients are theirs. kernels: the weights of the taps, see `bilinear`."""

    def __init__(self, grids: tuple[Grid, ...], target: TextureSet, seed: int, device: wp.Device):
        self.target, self.device = target, device
        self.spec = TextureSpec(*target.size, target.channels, 1, grids, hidden=(WIDTH, WIDTH))
        random = np.random.default_rng(seed)
        self.net = initial_network(self.spec, device, random)
        set_means(self.net, target.levels)
        latents = random.standard_normal((sum(self.vectors), 4), np.float32)
        self.parameters = Parameters(latents=wp.array(latents, dtype=wp.vec4, device=device))
        self.latents = self.parameters["latents"]
        self.read = wp.clone(self.latents)
        self.read.grad = self.latents.grad
        kernels = np.concatenate([bilinear(grid) for grid in grids])
        self.kernels = Parameters(kernels=wp.array(kernels, dtype=wp.vec4, device=device))

    @property
    def vectors(self) -> list[int]:
        """Of latents, of each grid."""
        spec = self.spec
        return [int(np.prod(spec.cells(0, g))) * grid.channels // 4 for g, grid in enumerate(spec.grids)]

    def grids(self) -> tuple[np.ndarray, ...]:
        """Latents, float32 [rows, columns, channels] each."""
        return split_latents(self.spec, self.latents.numpy().ravel())[0]

    def rounded(self, bits: int) -> TextureState:
        """With latents of so many bits each, in units of a step for each grid."""
        limit = 2 ** (bits - 1) - 1
        steps = [best_step(latents, limit) for latents in self.grids()]
        whole = [np.clip(np.rint(x / step), -limit, limit) for x, step in zip(self.grids(), steps, strict=True)]
        return self.state(whole, steps)

    def whole(self) -> TextureState:
        """With latents that were trained to be whole numbers."""
        return self.state([np.rint(latents) for latents in self.grids()])

    def state(self, latents: list[np.ndarray], steps: list[float] | None = None) -> TextureState:
        """What a file would hold. latents: whole numbers, in units of steps, 1 if not given."""
        latents = tuple(x.astype(np.int8) for x in latents)
        return TextureState(self.spec, (latents,), self.tensors(steps), self.target.maps)

    def tensors(self, steps: list[float] | None) -> dict[str, Tensor]:
        """The trained weights as whole numbers and a step; the network's first layer takes the latents' steps in."""
        found, kernels, first, weights = {}, self.kernels["kernels"].numpy(), 0, self.net.weights
        channels = [grid.channels for grid in self.spec.grids]
        for g, grid in enumerate(self.spec.grids):
            end = first + len(bilinear(grid))
            if grid.kernel == "learned":
                of_grid = kernels[first:end].reshape(-1, grid.scale, grid.scale, 4, 4)
                values = np.moveaxis(of_grid, -1, 1).reshape(grid.channels, grid.scale, grid.scale, 4)
                found[f"kernel_{g}"] = integers(values, step_of(values, PRECISION))
            first = end
        if steps is not None:
            weights = [weights[0] * np.repeat(np.float32(steps), channels), *weights[1:]]
        for l, (w, b) in enumerate(zip(weights, self.net.biases, strict=True)):
            found[f"weights_{l}"] = integers(w, step_of(w, PRECISION))
            found[f"biases_{l}"] = integers(b, step_of(b, BIASES))
        return found

    def point(self, state: TextureState, bits_of_latents: float, **about: float) -> "Point":
        """bits_of_latents: of all; the rest is counted here. about: what sets the point apart from others."""
        coded = 8 * len(numbers.pack([tensor.integers for tensor in state.tensors.values()]))
        bits = (bits_of_latents + coded + 16 * len(state.tensors)) / np.prod(self.target.size)
        values = Decoder(state, self.device).decode()
        return Point(float(bits), psnr(self.target.values, values), values, about)


@dataclass(frozen=True)
class Point:
    """Of a curve: bits a texel with everything counted, PSNR in dB of all channels, and the decoded channels."""

    bits: float
    psnr: float
    values: np.ndarray
    about: dict[str, float]

    @property
    def row(self) -> dict[str, float]:
        return {**self.about, "bits": self.bits, "psnr": self.psnr}


def best_step(latents: np.ndarray, limit: int) -> float:
    """Of the smallest squared error: where few bits are left, the largest latents are better cut off."""
    steps = np.abs(latents).max() / limit * np.linspace(0.2, 1.0, 33)
    errors = [np.square(latents - s * np.clip(np.rint(latents / s), -limit, limit)).mean() for s in steps]
    return float(steps[np.argmin(errors)])


def bilinear(grid: Grid) -> np.ndarray:
    """For every four channels, every place of a texel in its cell and every tap (own cell, right, below, right and
    below) the weights of bilinear interpolation times 0.3: [channels / 4 * scale * scale * 4, 4]. Latents are a few
    units large, what the network reads should not be."""
    f = (np.arange(grid.scale) + 0.5) / grid.scale
    line = np.stack([1 - f, f], -1)  # [scale, 2]
    taps = BILINEAR * np.einsum("ya,xb->yxab", line, line).reshape(-1, 1)
    return np.tile(taps, (grid.channels // 4, 4)).astype(np.float32)
