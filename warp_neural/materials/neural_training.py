"""What trains a neural material: steps on the latents of an encoder or of a texture, and on the sampler."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_neural.kernels.materials import neural_training as kernels
from warp_neural.kernels.materials.neural_spec import LATENTS, NeuralSpec, vec_latents
from warp_neural.kernels.materials.surface import vec_parameters
from warp_neural.kernels.nn.random import HELD_OUT
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.materials.layered import LayeredSet
from warp_neural.nn.mlp import MLP
from warp_neural.train.optim import Adam, cosine

CAPTURED = 32  # steps in one CUDA graph
TUNING, SAMPLER = HELD_OUT + 1, HELD_OUT + 2  # purposes of random numbers


@dataclass(frozen=True)
class Grid:
    """The latents' levels, [levels, 3]: start, height and width. lod: of the reference where the finest is meant."""

    levels: np.ndarray
    lod: float

    @property
    def texels(self) -> int:
        return int(self.levels[-1] @ [1, 0, 0] + self.levels[-1, 1] * self.levels[-1, 2])


def grid_of(side: int, largest: int) -> Grid:
    """Square latents under maps whose largest side is `largest`."""
    sizes = [max(side >> level, 1) for level in range(side.bit_length())]
    starts = np.cumsum([0, *[size * size for size in sizes]])[:-1]
    levels = np.stack([starts, sizes, sizes], axis=-1).astype(np.int32)
    return Grid(levels, float(np.log2(max(largest / side, 1.0))))


class Draws:
    """Samples of the reference, made by one launch: `places` with `pairs` of directions each."""

    def __init__(self, reference: LayeredSet, grid: Grid, places: int, pairs: int, for_sampler: bool = False):
        self.places, self.device, device = places, reference.device, reference.device
        count = places * pairs
        self.arrays = kernels.Draws()
        self.arrays.place = wp.zeros(places, dtype=wp.vec3, device=device)
        self.arrays.parameters = wp.zeros(places, dtype=vec_parameters, device=device)
        for name in ("light", "view", "target"):
            setattr(self.arrays, name, wp.zeros(count, dtype=wp.vec3, device=device))
        self.arrays.weight = wp.zeros(count if for_sampler else 1, dtype=float, device=device)
        self.arrays.albedo = wp.zeros(count if for_sampler else 1, dtype=wp.vec3, device=device)
        self.kernel = kernels.make_draw_kernel(reference.spec, pairs, for_sampler)
        self.inputs = [reference.params, 0, len(grid.levels), grid.lod]

    def draw(self, seed: int, steps: wp.array, purpose: int) -> None:
        inputs = [*self.inputs, seed, steps, purpose, self.arrays]
        wp.launch(self.kernel, self.places, inputs, device=self.device, record_tape=False)


def new_network(spec: NetworkSpec, seed: int, device: wp.Device) -> MLP:
    return MLP(
        spec.sizes[0], spec.sizes[-1], (*spec.sizes[1:-1], 1)[0], len(spec.sizes) - 2, activation=spec.activation,
        output_activation=spec.output_activation, precision=spec.format.name, seed=seed, device=device,
    )  # fmt: skip


class Training:
    """Networks, latents and what the launches of a step need; each `*_step` is one step, and draws anew."""

    def __init__(self, reference: LayeredSet, spec: NeuralSpec, grid: Grid, places: int, pairs: int, seed: int):
        self.reference, self.spec, self.grid, self.seed = reference, spec, grid, seed
        self.device, self.pairs, self.size = reference.device, pairs, places * pairs
        self.nets = {name: new_network(each, seed, self.device) for name, each in spec.networks.items()}
        self.encoder = new_network(kernels.ENCODER, seed, self.device)
        start = np.random.default_rng(seed).normal(0, 0.1, (grid.texels, LATENTS))
        self.texels = wp.array(start, dtype=vec_latents, device=self.device, requires_grad=True)
        self.levels = wp.array(grid.levels, dtype=wp.vec3i, device=self.device)
        self.latents = wp.zeros(places, dtype=vec_latents, device=self.device, requires_grad=True)
        self.losses = wp.zeros(self.size, dtype=float, device=self.device)
        self.ones = wp.ones(self.size, dtype=float, device=self.device)  # Adam does not mind the missing 1 / size
        self.draws = Draws(reference, grid, places, pairs)

    def encode(self, adjoint: bool) -> None:
        inputs = [self.encoder.params, self.draws.arrays.parameters]
        self._latents(kernels.make_encode_kernel(), inputs, [self.encoder.params, None], adjoint)

    def read(self, adjoint: bool) -> None:
        inputs = [self.texels, self.levels, self.draws.arrays.place]
        self._latents(kernels.read_kernel, inputs, [self.texels.grad, None, None], adjoint)

    def _latents(self, kernel: wp.Kernel, inputs: list, gradients: list, adjoint: bool) -> None:
        adjoints = {"adjoint": True, "adj_inputs": gradients, "adj_outputs": [self.latents.grad]} if adjoint else {}
        wp.launch(kernel, self.latents.size, inputs, [self.latents], device=self.device, record_tape=False, **adjoints)

    def decoder_step(self, latents_of: Callable[[bool], None], optimizers: list[Adam], purpose: int) -> None:
        """latents_of: `encode` or `read`. optimizers: of what is trained. purpose: of the random numbers."""
        self.draws.draw(self.seed, optimizers[0].steps, purpose)
        latents_of(False)
        self.latents.grad.zero_()
        params, frames = self.nets["decoder"].params, self.nets["frames"].params
        wp.launch(
            kernels.make_loss_kernel(self.spec, self.pairs), self.size,
            [params, frames, self.latents, self.draws.arrays], [self.losses], adjoint=True,
            adj_inputs=[params, frames, self.latents.grad, kernels.Draws()], adj_outputs=[self.ones],
            device=self.device, record_tape=False,
        )  # fmt: skip
        latents_of(True)
        self._update(optimizers, (self.nets["decoder"], self.nets["frames"], self.encoder))

    def sampler_step(self, draws: Draws, optimizers: list[Adam]) -> None:
        """On latents as they are. draws: with weights."""
        draws.draw(self.seed, optimizers[0].steps, SAMPLER)
        inputs = [self.texels, self.levels, draws.arrays.place]
        wp.launch(kernels.read_kernel, self.latents.size, inputs, [self.latents], device=self.device, record_tape=False)
        params = self.nets["sampler"].params
        wp.launch(
            kernels.make_sampler_loss_kernel(self.spec, self.pairs), self.size,
            [params, self.latents, draws.arrays], [self.losses], adjoint=True,
            adj_inputs=[params, None, kernels.Draws()], adj_outputs=[self.ones],
            device=self.device, record_tape=False,
        )  # fmt: skip
        self._update(optimizers, (self.nets["sampler"],))

    def _update(self, optimizers: list[Adam], nets: tuple[MLP, ...]) -> None:
        for optimizer in optimizers:
            optimizer.step()
        for net in nets:
            net.pack()

    def bake(self) -> None:
        """The encoder's latents into the texture."""
        kernel = kernels.make_bake_kernel(self.reference.spec)
        for i, level in enumerate(self.grid.levels):
            inputs = [self.reference.params, 0, self.grid.lod + i, self.encoder.params, wp.vec3i(*level), self.texels]
            wp.launch(kernel, tuple(level[1:]), inputs, device=self.device, record_tape=False)

    def optimizers(self, rates: dict, steps: int) -> list[Adam]:
        """Of arrays with gradients, each from its rate down to a hundredth on a cosine."""
        return [Adam(p, lr=cosine(r, r / 100, steps), beta2=0.99, clear=True) for p, r in rates.items()]


def run(device: wp.Device, steps: int, step: Callable[[], None], seen: Callable[[int], None]) -> None:
    """`steps` times `step`, by a CUDA graph of several where there is one. seen: called with how many were done."""
    step()  # compiles, before anything is captured
    seen(1)
    graph, done = None, 1
    while done < steps:
        count = 1
        if device.is_cuda and steps - done >= CAPTURED:
            count = CAPTURED
            if graph is None:
                with wp.ScopedCapture(device) as capture:
                    for _ in range(count):
                        step()
                graph = capture.graph
            wp.capture_launch(graph)
        else:
            step()
        seen(count)
        done += count
