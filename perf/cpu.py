"""One CPU core beside PyTorch and Dr.Jit, where they are installed: `python -m perf.cpu`.

`inference`: rows of 32 float32 in memory through 32-32-32-16. `training`: a step of 2 inputs, frequency encoding (8
octaves: 32 values), 32-32-3, ReLU, L2, Adam, that draws and encodes its samples; `fused` is the kernel that a `Trainer`
takes, `taped` goes through the adjoint of the loss. All with one thread, in turn, so that a busy machine is busy for
all; results and gradients are compared with float64 first. torch.compile is left out with --quick.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from perf import peers
from perf.measure import Bench, Config, check, times_in_turn
from perf.networks import flops, make_net, true_gradient, truth
from perf.pictures import bars
from perf.precision import OCTAVES, encode
from warp_neural import MLP, Trainer, encodings
from warp_neural.cli import Samples, run
from warp_neural.kernels.coopvec.rows import make_evaluate_kernel
from warp_neural.kernels.nn.random import Stream, stream, uniform

GRADIENT_LIMITS = {"float32": 1e-5, "float16": 1e-2}


@dataclass(frozen=True, kw_only=True)
class CpuConfig(Config):
    device: str = "cpu"
    """the CPU, whatever else there is"""
    samples: Samples = 1 << 14
    """rows, and samples of a step"""


@wp.func
def draw(index: int, random: Stream):
    u = uniform(random, 0)
    x = wp.vec2(u[0], u[1])
    return x, wp.vec3(x[0], x[0] * x[1], (1.0 - x[0]) * x[1])


@wp.kernel(enable_backward=False)
def draw_kernel(seed: wp.uint64, xs: wp.array[wp.vec2], targets: wp.array[wp.vec3]):
    """The samples of step 0."""
    i = wp.tid()
    x, target = draw(i, stream(seed, 0, i))
    xs[i] = x
    targets[i] = target


def measure_inference(bench: Bench, config: CpuConfig) -> None:
    net = make_net(2, 32, precision="float32", device="cpu", seed=config.seed)
    kernel = make_evaluate_kernel(net.of_row, net.vec_out)
    x = np.random.default_rng(0).uniform(-1, 1, (config.samples, 32)).astype(np.float32)
    inputs, y = wp.array(x, dtype=float, device="cpu"), wp.zeros((len(x), 16), dtype=float, device="cpu")

    def ours() -> np.ndarray:
        wp.launch(kernel, len(x), [net.params, inputs, y], device="cpu")
        return y.numpy()

    calls = {"Warp Neural": ours} | peers.inference(peers.weights_and_biases(net), x, compiled=not config.quick)
    for name, call in calls.items():
        check(f"inference, {name}", call(), truth(net, x), 1e-5)
    for name, values in times_in_turn(calls, config.rounds).items():
        bench.add(name, "inference", values, "ms")
        bench.speed_of(name, "inference, speed", values, len(x) * flops(net))


def make_trainer(config: CpuConfig, precision: str, fused: bool | None) -> Trainer:
    net = MLP(2, 3, 32, 2, encoding=encodings.Frequency(OCTAVES), precision=precision, device="cpu", seed=config.seed)
    trainer = Trainer(net, sample=draw, batch=config.samples, fused=fused, seed=config.seed)
    xs, targets = (wp.zeros(config.samples, dtype=dtype, device="cpu") for dtype in (wp.vec2, wp.vec3))
    wp.launch(draw_kernel, config.samples, [config.seed, xs, targets], device="cpu")
    expected = true_gradient(net, encode(xs.numpy()), targets.numpy())
    found = trainer.gradient()[: net.spec.n_parameters]
    check(f"{precision} fused={fused}", found, expected, GRADIENT_LIMITS[precision])
    return trainer


def measure_training(bench: Bench, config: CpuConfig) -> None:
    calls: dict[str, Callable] = {}
    for name, precision, fused in (
        ("Warp Neural", "float32", None),
        ("Warp Neural, float16", "float16", None),
        ("Warp Neural, taped", "float32", False),
    ):
        if not (config.quick and fused is False):
            trainer = make_trainer(config, precision, fused)
            calls[name] = lambda trainer=trainer: trainer.run(1, quiet=True)
    net = MLP(2, 3, 32, 2, encoding=encodings.Frequency(OCTAVES), precision="float32", device="cpu", seed=config.seed)

    def check_gradient(name: str, inputs: np.ndarray, targets: np.ndarray, found: np.ndarray) -> None:
        check(f"{name}, gradient", found, true_gradient(net, inputs, targets), 1e-5)

    calls |= peers.training(peers.weights_and_biases(net), OCTAVES, config.samples, check_gradient)
    for name, values in times_in_turn(calls, config.rounds).items():
        bench.add(name, "training step", values, "ms")


def main(config: CpuConfig) -> dict:
    bench = Bench("cpu", config, samples=f"{config.samples:,}", precision="float32 unless named", threads=1)
    if bench.device.is_cuda:
        bench.device = wp.get_device("cpu")
    if peers.missing():
        bench.result.settings["not installed"] = " and ".join(peers.missing())
    measure_inference(bench, config)
    measure_training(bench, config)
    return bench.finish(lambda result: bars(result, "One core", "ms"))


if __name__ == "__main__":
    run(main, CpuConfig)
