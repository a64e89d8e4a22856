"""A training step of a neural texture beside plain PyTorch: `python -m perf.texture_torch`.

65,536 texels of 8 channels. In PyTorch, grids, network, loss, rate and Adam are as `perf.texture_torch_model` writes
them down, called one after the other (eager) and by torch.compile, in float32 and by autocast; on CUDA also as a CUDA
graph, where PyTorch can capture it. On the CPU PyTorch takes all cores. Loss and gradients of both are the same
(`tests/test_texture_torch.py`). With --quick only eager; `pip install -e '.[peers]'` brings PyTorch.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Annotated

import numpy as np

from perf.measure import WARM_UP, Bench, Config, wall_ms
from perf.peers_cuda import add, graph_times
from perf.pictures import bars
from warp_neural.cli import Between, progress, run
from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.latent_trainer import CHECK
from warp_neural.texture.trainer import TextureTrainer

GRIDS = (Grid(2, 12), Grid(4, 16), Grid(8, 12, "separable"), Grid(16, 8, "bilinear"))
RATE_WEIGHT = 1e-3
LEARNING = 10  # steps in which the loss must fall before anything is timed


@dataclass(frozen=True, kw_only=True)
class TextureConfig(Config):
    side: Annotated[int, Between(32, 8192, multiple=32)] = 1024
    """texels of the texture, each way"""
    tiles: Annotated[int, Between(1, 4096)] = 64
    """of a step, 32 x 32 texels each"""


def targets(side: int, channels: int, seed: int) -> np.ndarray:
    """Waves and a little noise, float32 [side, side, channels] in [0, 1]."""
    rng = np.random.default_rng(seed)
    i, j = np.mgrid[:side, :side] / side
    waves = [np.sin(2 * np.pi * (a * i + b * j)) for a, b in rng.integers(1, 20, (channels, 2))]
    noisy = 0.5 + 0.3 * np.stack(waves, -1) + 0.05 * rng.standard_normal((side, side, channels))
    return np.clip(noisy, 0, 1).astype(np.float32)


def calls(config: TextureConfig, device: str) -> dict[str, tuple[Callable, Callable]]:
    """By name, what makes a step and what times it."""
    import torch

    from perf.texture_torch_model import Texture, make_step

    spec = TextureSpec(config.side, config.side, 8, 1, GRIDS)
    values = targets(config.side, spec.channels, config.seed)

    def maker(dtype: torch.dtype, compiled: bool) -> Callable:
        def make() -> Callable:
            torch.manual_seed(config.seed)
            step = make_step(Texture(spec, values, RATE_WEIGHT).to(device), config.tiles, dtype, compiled)
            return learning(step)

        return make

    halves = {"bfloat16": torch.bfloat16} | ({"float16": torch.float16} if device == "cuda" else {})
    found = {}
    for name, dtype in ({"float32": torch.float32} | halves).items():
        found[f"PyTorch eager, {name}"] = maker(dtype, False), call_times
        if not config.quick:
            found[f"torch.compile, {name}"] = maker(dtype, True), call_times
            if device == "cuda":
                found[f"PyTorch, CUDA graph, {name}"] = maker(dtype, False), graph_times
    return found


def learning(step: Callable) -> Callable:
    """`step`, after its loss has fallen."""
    losses = [float(step().detach()) for _ in range(LEARNING)]
    if not losses[-1] < losses[0]:
        raise RuntimeError(f"the loss went from {losses[0]:.3g} to {losses[-1]:.3g}; nothing was timed")
    return step


def measure_ours(bench: Bench, config: TextureConfig) -> None:
    """Of `TextureTrainer`, in the noise phase, as many steps at once as a CUDA graph takes."""
    spec = TextureSpec(config.side, config.side, 8, 1, GRIDS)
    values = [targets(config.side, spec.channels, config.seed)]
    options = {"rate_weight": RATE_WEIGHT, "tiles": config.tiles, "seed": config.seed, "device": bench.device}
    at_once = CHECK if bench.device.is_cuda else 1
    trainer = TextureTrainer(spec, values, steps=4 * at_once * (WARM_UP + config.rounds), **options)

    def take_steps() -> None:
        trainer.run(trainer.index + at_once)

    take_steps()  # compiles
    rounds = [wall_ms(take_steps, 2) for _ in range(WARM_UP + config.rounds)]
    bench.add("Warp Neural", "step", np.array(rounds[WARM_UP:]) / at_once, "ms")


def call_times(step: Callable, rounds: int) -> tuple[np.ndarray, str]:
    """Milliseconds of a step in each round, [rounds], by the wall clock."""
    repeat = int(np.clip(100 // wall_ms(step, 1), 1, 50))
    return np.array([wall_ms(step, repeat) for _ in range(WARM_UP + rounds)][WARM_UP:]), ""


def main(config: TextureConfig) -> dict:
    if not find_spec("torch"):
        raise InputError("PyTorch: not installed; pip install -e '.[peers]'")
    import torch

    bench = Bench("texture_torch", config)
    measure_ours(bench, config)
    device = "cuda" if bench.device.is_cuda else "cpu"
    bench.result.settings |= {"PyTorch": torch.__version__, "texture": f"{config.side} x {config.side}, 8 channels"}
    bench.result.settings["step"] = f"{config.tiles * 32 * 32:,} texels"
    if device == "cpu":
        bench.result.settings["cores for PyTorch"] = str(torch.get_num_threads())
    for name, (make, times) in progress(calls(config, device).items(), config):
        add(bench, name, "step", make, times)
    return bench.finish(lambda result: bars(result, "A training step of a neural texture", "ms"))


if __name__ == "__main__":
    run(main, TextureConfig)
