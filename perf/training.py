"""Time of a training step on CUDA: `python -m perf.training`, beside what other libraries took on an H200 (recorded).

`LxN`: float16 rows of N inputs and 16 targets in memory, L hidden layers of N neurons, ReLU, biases, L2, Adam, at 2^18
and 2^16 samples a step; then encodings of a 2-megapixel image (2x64, RGB). Steps lie in a CUDA graph of 32; medians of
15 launches after 3 of warm-up. `gradient` and `update` are the parts, each in a graph of its own. The gradient of every
network is compared with float64 before anything is timed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_neural import MLP, InputError, Trainer, encodings
from warp_neural.cli import CommonConfig, progress, resolve_device, run
from warp_neural.coopvec import make_load

STEPS = 32  # in a graph
# milliseconds a step at 2^18 and 2^16 samples: tiny-cuda-nn (JIT, best layout; 3x128 without JIT)
RECORDED = {
    (2, 32): (0.0850, 0.0336), (3, 32): (0.0844, 0.0347), (2, 64): (0.1320, 0.0457), (3, 64): (0.1594, 0.0513),
    (3, 16): (0.0663, 0.0286), "frequency": (0.0776, 0.0326), "hash_grid": (0.4125, float("nan")),
}  # fmt: skip
ENCODINGS = {
    "frequency": encodings.Frequency(8),
    "latent_texture": encodings.LatentTexture(64, 64, 8),
    "hash_grid": encodings.HashGrid(),
}


@dataclass(frozen=True)
class Config(CommonConfig):
    accumulation: str = "float16"
    """of the forward pass: float16 or float32"""
    rounds: int = 15
    """launches of 32 steps that count"""


@wp.struct
class Rows:
    x: wp.array2d[wp.float16]
    target: wp.array2d[wp.float16]


def make_row_sample(width: int) -> wp.Function:
    load_x, load_target = make_load(width, wp.float16), make_load(16, wp.float16)
    vec_out = wp.types.vector(16, float)

    @wp.func
    def sample(index: int, random: wp.uint32, rows: Rows):
        row = load_target(rows.target, index)
        target = vec_out()
        for n in range(16):
            target[n] = float(row[n])
        return load_x(rows.x, index), target

    return sample


@wp.func
def pixel(index: int, random: wp.uint32, image: wp.array2d[wp.vec3]):
    u = wp.randf(random)
    v = wp.randf(random)
    i = wp.min(int(v * float(image.shape[0])), image.shape[0] - 1)
    j = wp.min(int(u * float(image.shape[1])), image.shape[1] - 1)
    return wp.vec2(u, v), image[i, j]


def true_gradient(net: MLP, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Of the mean of squares of the ReLU network, float64, in the order of `net.master`."""
    kept, weights = [x.astype(np.float64)], [w.astype(np.float16).astype(np.float64) for w in net.weights]
    for i, (w, b) in enumerate(zip(weights, net.biases, strict=True)):
        z = kept[-1] @ w.T + b
        kept.append(np.maximum(z, 0) if i < len(weights) - 1 else z)
    d, parts = 2 * (kept[-1] - target) / target.size, []
    for i, w in reversed(list(enumerate(weights))):
        parts.insert(0, np.concatenate([(d.T @ kept[i]).ravel(), d.sum(0)]))
        d = d @ w * (kept[i] > 0)
    return np.concatenate(parts)


def row_trainer(config: Config, device: wp.Device, depth: int, width: int, batch: int) -> Trainer:
    kind = {"accumulation": config.accumulation, "dtype": wp.float16, "device": device, "seed": config.seed}
    net, rng, rows = MLP(width, 16, width, depth, **kind), np.random.default_rng(config.seed), Rows()
    net.biases = [rng.uniform(-0.1, 0.1, b.shape) for b in net.biases]
    x = rng.uniform(-1, 1, (batch, width)).astype(np.float16)
    target = np.sin(3 * x[:, :16].astype(np.float32) + x[:, :1]).astype(np.float16)
    rows.x, rows.target = (wp.array(a, dtype=wp.float16, device=device) for a in (x, target))
    trainer = Trainer(net, sample=SAMPLES[width], data=rows, batch=batch)
    some = min(batch, 4096)
    checked = Trainer(net, sample=SAMPLES[width], data=rows, batch=some)
    expected = true_gradient(net, x[:some], target[:some])
    error = np.linalg.norm(checked.gradient()[: net.n_parameters] - expected) / np.linalg.norm(expected)
    if not error < 1e-2:
        raise RuntimeError(f"{depth}x{width}: the gradient's relative error is {error:.1e}; nothing was timed")
    return trainer


SAMPLES = {width: make_row_sample(width) for width in (16, 32, 64, 128)}


def image_trainer(config: Config, device: wp.Device, encoding: encodings.Encoding, batch: int) -> Trainer:
    y, x = np.mgrid[:1024, :2048] / 1024
    channels = [0.5 + 0.5 * np.sin(40 * x * y), 0.5 + 0.5 * np.cos(60 * x + 20 * y * y), (16 * x + 16 * y) % 2 < 1]
    image = wp.array(np.stack(channels, -1).astype(np.float32), dtype=wp.vec3, device=device)
    kind = {"accumulation": config.accumulation, "device": device, "seed": config.seed}
    return Trainer(MLP(2, 3, 64, 2, encoding=encoding, **kind), sample=pixel, data=image, batch=batch)


def median_ms(action: Callable[[], None], device: wp.Device, rounds: int) -> float:
    """Of one call of `action`, repeated in a graph."""
    action()
    with wp.ScopedCapture(device) as capture:
        for _ in range(STEPS):
            action()
    times = []
    for _ in range(3 + rounds):
        with wp.ScopedTimer("", print=False, synchronize=True) as timer:
            wp.capture_launch(capture.graph)
        times.append(timer.elapsed / STEPS)
    return float(np.median(times[3:]))


def measure(trainer: Trainer, rounds: int) -> tuple[float, float, float]:
    """Milliseconds of a step, of its gradient and of its update."""
    launches, device = trainer.launches, trainer.device

    def step() -> None:
        launches.gradient(0)
        launches.update()

    return tuple(median_ms(action, device, rounds) for action in (step, lambda: launches.gradient(0), launches.update))


def main(config: Config) -> dict:
    device = resolve_device(config.device)
    if not device.is_cuda:
        raise InputError(f"--device {device.alias}: this measures CUDA; for the CPU there is perf.training_cpu")
    metrics = {"device": device.name, "warp": wp.__version__, "accumulation": config.accumulation}
    print(
        "| network | samples | ms a step | gradient | update | tiny-cuda-nn (recorded) | ratio |\n" + "|---" * 7 + "|"
    )
    shapes = [(2, 32), (3, 32), (2, 64), (3, 64), (3, 16), *ENCODINGS]
    for shape in progress(shapes, config):
        for i, batch in enumerate((1 << 18, 1 << 16)):
            if shape in ENCODINGS:
                name, trainer = shape, image_trainer(config, device, ENCODINGS[shape], batch)
            else:
                name, trainer = f"{shape[0]}x{shape[1]}", row_trainer(config, device, *shape, batch)
            step, gradient, update = measure(trainer, config.rounds)
            peer = RECORDED.get(shape, (float("nan"),) * 2)[i]
            print(f"| {name} | {batch} | {step:.4f} | {gradient:.4f} | {update:.4f} | {peer:.4f} | {step / peer:.2f} |")
            metrics[f"{name}_{batch}_ms"], metrics[f"{name}_{batch}_update_ms"] = step, update
    return metrics


if __name__ == "__main__":
    run(main, Config)
