"""Speed of a training step on one CPU core: `python -m perf.training_cpu`, with PyTorch eager beside it if installed.

2 inputs, frequency encoding (8 octaves: 32 values), 32-32-3, ReLU, L2, Adam; every step draws and encodes its samples.
`fused`: the kernel that a `Trainer` takes on the CPU; `general`: through the adjoint of the loss; `torch`: the same in
PyTorch, and `torch_encoded`: with samples drawn and encoded beforehand. Gradients are compared with float64 before
anything is timed. One thread each, in turn; medians of the rounds after 3 of warm-up.
"""

import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import warp as wp

from kernels.sampling import random_stream
from warp_neural import MLP, Trainer, encodings
from warp_neural.cli import CommonConfig, run

OCTAVES, WARM_UP, STEPS = 8, 3, 8  # STEPS: of a round
LIMITS = {"float32": 1e-5, "float16": 1e-2}  # relative errors of gradients


@dataclass(frozen=True)
class Config(CommonConfig):
    samples: int = 1 << 14
    """samples a step"""
    rounds: int = 40
    """rounds of 8 steps that count"""


@wp.func
def draw(index: int, random: wp.uint32):
    x = wp.vec2(wp.randf(random), wp.randf(random))
    return x, wp.vec3(x[0], x[0] * x[1], (1.0 - x[0]) * x[1])


@wp.kernel
def draw_kernel(seed: int, xs: wp.array[wp.vec2], targets: wp.array[wp.vec3]):
    """The samples of step 0."""
    i = wp.tid()
    x, target = draw(i, random_stream(seed, 0, i))
    xs[i] = x
    targets[i] = target


def encode(x: np.ndarray) -> np.ndarray:
    """As `encodings.Frequency`, [n, 2] to [n, 32]."""
    angles = np.pi * x[:, :, None] * 2.0 ** np.arange(OCTAVES)
    return np.stack([np.sin(angles), np.cos(angles)], -1).reshape(len(x), -1)


def true_gradient(net: MLP, inputs: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Of the mean of squares, for encoded inputs [n, 32]; float64, in the order of `net.master`."""
    layers = [(w.astype(np.float64), b) for w, b in zip(net.weights, net.biases, strict=True)]
    kept = [inputs.astype(np.float64)]
    for i, (w, b) in enumerate(layers):
        z = kept[-1] @ w.T + b
        kept.append(np.maximum(z, 0) if i < len(layers) - 1 else z)
    d, parts = 2 * (kept[-1] - target) / target.size, []
    for i, (w, _) in reversed(list(enumerate(layers))):
        parts.insert(0, np.concatenate([(d.T @ kept[i]).ravel(), d.sum(0)]))
        d = d @ w * (kept[i] > 0)
    return np.concatenate(parts)


def check(name: str, gradient: np.ndarray, expected: np.ndarray, limit: float) -> None:
    error = np.linalg.norm(gradient - expected) / np.linalg.norm(expected)
    if not error <= limit:
        raise RuntimeError(f"{name}: relative error {error:.1e} is above {limit:.1e}; nothing was timed")


def make_trainer(config: Config, precision: str, fused: bool | None) -> Trainer:
    encoding = encodings.Frequency(OCTAVES)
    net = MLP(2, 3, 32, 2, encoding=encoding, precision=precision, device="cpu", seed=config.seed)
    trainer = Trainer(net, sample=draw, batch=config.samples, fused=fused, seed=config.seed)
    xs, targets = (wp.zeros(config.samples, dtype=dtype, device="cpu") for dtype in (wp.vec2, wp.vec3))
    wp.launch(draw_kernel, config.samples, [config.seed, xs, targets], device="cpu")
    expected = true_gradient(net, encode(xs.numpy().astype(np.float64)), targets.numpy())
    check(f"{precision} fused={fused}", trainer.gradient()[: net.n_parameters], expected, LIMITS[precision])
    return trainer


def torch_model(net: MLP):
    """The network behind the encoding, with the same parameters."""
    from torch import from_numpy, nn, no_grad

    model = nn.Sequential(nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 3))
    layers = [layer for layer in model if isinstance(layer, nn.Linear)]
    with no_grad():
        for layer, weights, biases in zip(layers, net.weights, net.biases, strict=True):
            layer.weight.copy_(from_numpy(weights))
            layer.bias.copy_(from_numpy(biases))
    return model


def make_torch(config: Config) -> dict[str, Callable]:
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(config.seed)
    net = MLP(2, 3, 32, 2, encoding=encodings.Frequency(OCTAVES), precision="float32", device="cpu", seed=config.seed)
    frequencies = torch.pi * 2.0 ** torch.arange(OCTAVES)

    def samples():
        x = torch.rand(config.samples, 2)
        u, v = x.unbind(1)
        angles = x[:, :, None] * frequencies
        return torch.stack([angles.sin(), angles.cos()], -1).flatten(1), torch.stack([u, u * v, (1 - u) * v], 1)

    def make_step(draw_samples: Callable) -> Callable:
        model = torch_model(net)
        optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)

        def gradient():
            inputs, targets = draw_samples()
            optimizer.zero_grad()
            torch.nn.functional.mse_loss(model(inputs), targets).backward()
            return inputs, targets

        def steps():
            for _ in range(STEPS):
                gradient()
                optimizer.step()

        inputs, targets = gradient()
        found = torch.cat([parameter.grad.flatten() for parameter in model.parameters()]).numpy()
        check("torch", found, true_gradient(net, inputs.numpy(), targets.numpy()), LIMITS["float32"])
        return steps

    fixed = samples()
    return {"torch": make_step(samples), "torch_encoded": make_step(lambda: fixed)}


def step_times(kinds: dict[str, Callable], rounds: int) -> dict[str, np.ndarray]:
    """Milliseconds of a step, [rounds] of each kind, taken in turn so that a busy machine is busy for all."""
    times = {name: [] for name in kinds}
    for _ in range(WARM_UP + rounds):
        for name, steps in kinds.items():
            begin = time.perf_counter()
            steps()
            times[name].append((time.perf_counter() - begin) * 1e3 / STEPS)
    return {name: np.array(values[WARM_UP:]) for name, values in times.items()}


def main(config: Config) -> dict:
    kinds, metrics = {}, {"cpu": platform.processor() or platform.machine(), "warp": wp.__version__}
    metrics |= {"samples": config.samples, "rounds": config.rounds}
    for kind, fused in (("fused", None), ("general", False)):
        for precision in LIMITS:
            trainer = make_trainer(config, precision, fused)
            kinds[f"{kind}_{precision}"] = lambda trainer=trainer: trainer.run(STEPS, quiet=True)
    if find_spec("torch"):
        kinds |= make_torch(config)
    else:
        print("PyTorch is not installed: not compared (pip install torch)")
    times = step_times(kinds, config.rounds)
    reference = float(np.median(times["fused_float32"]))
    print("| step | median ms | fastest | times `fused_float32` |\n|---|---:|---:|---:|")
    for name, values in times.items():
        median = float(np.median(values))
        print(f"| {name} | {median:.2f} | {values.min():.2f} | {median / reference:.2f} |")
        metrics |= {f"{name}_ms": median, f"{name}_fastest_ms": float(values.min())}
    return metrics


if __name__ == "__main__":
    run(main, Config)
