"""From a layered material to a neural one."""

import time
from dataclasses import dataclass

import numpy as np
import warp as wp
from tqdm import tqdm

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.errors import require_whole
from warp_neural.kernels.materials.neural_spec import LATENTS, NeuralSpec
from warp_neural.kernels.materials.neural_training import make_error_kernel
from warp_neural.kernels.nn.random import HELD_OUT, TRAINING
from warp_neural.materials.layered import LayeredMaterial, LayeredSet
from warp_neural.materials.neural import NeuralMaterial
from warp_neural.materials.neural_state import NeuralState, quantized
from warp_neural.materials.neural_training import TUNING, Draws, Training, grid_of, run

WAYS = ("texture", "encoder")


@dataclass(frozen=True)
class Effort:
    """side: texels of the finest latents' sides. steps: of the decoder, of which the last eighth tunes texture and
    decoder without the encoder. sampler_steps: after them. A step sees `places`, each with `pairs` of directions."""

    side: int
    steps: int
    sampler_steps: int
    places: int
    pairs: int = 8
    rate: float = 4e-3

    def __post_init__(self) -> None:
        for name, least in (("side", 1), ("steps", 4), ("sampler_steps", 0), ("places", 1), ("pairs", 1)):
            require_whole(name, getattr(self, name), least)


def effort_of(device: wp.Device, side: int | None = None, preview: bool = False) -> Effort:
    """What a device has time for: about a minute, and for a preview a few seconds."""
    if device.is_cuda:
        effort = Effort(side or 1024, 8000, 3000, 8192)
    else:
        effort = Effort(side or 128, 3000, 600, 256)
    return Effort(effort.side, effort.steps // 10, effort.sampler_steps // 5, effort.places) if preview else effort


def bake(
    material: LayeredMaterial,
    spec: NeuralSpec | None = None,
    *,
    way: str = "encoder",
    effort: Effort | None = None,
    seed: int = 0,
    device: wp.DeviceLike = None,
    quiet: bool = True,
) -> NeuralMaterial:
    """Train latents, decoder and sampler on a layered material, the same for a seed on one device (on CUDA but for the
    order of sums).

    way: "encoder" trains an encoder from the material's parameters with the decoder, bakes the latents with it and
    throws it away; "texture" trains latents of their own for each texel from the start. `metrics` of the state: errors
    as `error_of`, and seconds. Coarser levels are trained on the reference's own, by its filtered maps.
    """
    if way not in WAYS:
        raise InputError(f"way={way!r}: give one of {', '.join(WAYS)}")
    device, spec = find_device(device), spec or NeuralSpec()
    effort = effort or effort_of(device)
    began = time.perf_counter()
    reference = LayeredSet(material, device=device)
    largest = max((max(material.value(name).shape[:2]) for name in material.maps), default=1)
    grid = grid_of(effort.side, largest)
    training = Training(reference, spec, grid, effort.places, effort.pairs, seed)
    with tqdm(total=effort.steps + effort.sampler_steps, disable=True if quiet else None, unit="step") as bar:
        _train_decoder(training, way, effort, bar.update)
        _train_sampler(training, effort, bar.update)
    wp.synchronize_device(device)
    seconds = time.perf_counter() - began
    state = _state(training, material.name)
    error = error_of(NeuralMaterial(state, device=device), reference, grid.lod)
    state.metrics.update({"error": error, "seconds": seconds, "way": way, "samples": effort.steps * training.size})
    return NeuralMaterial(state, device=device)


def error_of(neural: NeuralMaterial, reference: LayeredSet, lod: float = 0.0, count: int = 1 << 16) -> float:
    """Mean |log(1 + value) - log(1 + reference)| of f cos at the finest level, over held-out places and directions:
    views uniform, lights half uniform and half as the reference samples them. lod: of the reference."""
    grid = grid_of(1, 1)
    draws = Draws(reference, type(grid)(grid.levels, lod), count, 1)
    step = wp.zeros(1, dtype=int, device=neural.device)
    draws.draw(0, step, HELD_OUT)
    errors = wp.zeros(count, dtype=float, device=neural.device)
    kernel = make_error_kernel(neural.Params, neural.evaluate)
    wp.launch(kernel, count, [neural.params, 0, draws.arrays], [errors], device=neural.device, record_tape=False)
    return float(errors.numpy().mean(dtype=np.float64))


def _train_decoder(training: Training, way: str, effort: Effort, seen) -> None:
    nets, rate, device = training.nets, effort.rate, training.device
    networks = {nets["decoder"].master: rate}
    if training.spec.frames:
        networks[nets["frames"].master] = rate
    if way == "texture":
        optimizers = training.optimizers({**networks, training.texels: 5 * rate}, effort.steps)
        run(device, effort.steps, lambda: training.decoder_step(training.read, optimizers, TRAINING), seen)
        return
    first = effort.steps - effort.steps // 8
    optimizers = training.optimizers({**networks, training.encoder.master: 0.75 * rate}, first)
    run(device, first, lambda: training.decoder_step(training.encode, optimizers, TRAINING), seen)
    training.bake()
    tuned = {array: each / 8 for array, each in networks.items()} | {training.texels: rate / 8}
    tuners = training.optimizers(tuned, effort.steps - first)
    run(device, effort.steps - first, lambda: training.decoder_step(training.read, tuners, TUNING), seen)


def _train_sampler(training: Training, effort: Effort, seen) -> None:
    if not effort.sampler_steps:
        return
    draws = Draws(training.reference, training.grid, effort.places, effort.pairs, for_sampler=True)
    optimizers = training.optimizers({training.nets["sampler"].master: effort.rate}, effort.sampler_steps)
    run(training.device, effort.sampler_steps, lambda: training.sampler_step(draws, optimizers), seen)


def _state(training: Training, source: str) -> NeuralState:
    flat = training.texels.numpy()
    levels = [flat[start : start + h * w].reshape(h, w, LATENTS) for start, h, w in training.grid.levels]
    codes, scale = quantized(levels)
    return NeuralState(training.spec, {name: net.state for name, net in training.nets.items()}, codes, scale, source)
