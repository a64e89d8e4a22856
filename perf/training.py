"""Time of a training step and of its parts: `python -m perf.training`, beside what other libraries took on an H200.

`LxN`: float16 rows of N inputs and 16 targets in memory, L hidden layers of N neurons, ReLU, biases, L2, Adam; then
encodings of a 2-megapixel image (2x64, RGB; on the CPU 2x32 and an eighth of the side). On CUDA float16 with float16
sums, on the CPU float32. `course step`: networks of `samples.network`. `texture`: that
of `samples.hardware_acceleration`, in plain arithmetic (`per_thread`) and cooperative; `unfused`: in the same kernels.

`forward`: the network alone, on the same rows; `gradient`: samples, forward, loss, backward and what blocks add up;
`update`: the sum over blocks, Adam and the packed weights, left out for a hash grid, as after the first its gradient is
zero and its entries rest; `step`: gradient and update. The gradient of every LxN is compared with float64 before it is
timed. On CUDA other libraries that are installed train on the rows of LxN (`perf.peers_cuda`), on one core they do in
`perf.cpu`.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import warp as wp

from perf import peers_cuda, recorded
from perf.measure import Bench, Config, check
from perf.networks import make_net, shape_name, true_gradient
from perf.pictures import steps
from warp_neural import MLP, Trainer, encodings
from warp_neural.cli import Between, progress, run
from warp_neural.coopvec import make_load
from warp_neural.kernels.coopvec.rows import make_evaluate_kernel
from warp_neural.kernels.nn.random import Stream, uniform
from warp_neural.samples.hardware_acceleration import texture
from warp_neural.samples.network import step_02_multiple_layers, step_04_frequency_encoding

SHAPES = [(2, 32), (3, 32), (2, 64), (3, 64), (3, 16), (3, 128)]
ENCODINGS = {
    "frequency": encodings.Frequency(8),
    "latent texture": encodings.LatentTexture(64, 64, 8),
    "hash grid": encodings.HashGrid(),
}
COURSE = {"course step 2": step_02_multiple_layers, "course step 4": step_04_frequency_encoding}


@dataclass(frozen=True, kw_only=True)
class TrainingConfig(Config):
    batch: Annotated[int, Between(0, 2**26)] = 0
    """samples a step; 0: 2^18, 2^16 and 2^14 on CUDA, 2^14 and 2^12 on the CPU"""


@wp.struct
class Rows:
    x: wp.array2d[wp.float16]
    target: wp.array2d[wp.float16]


def make_row_sample(width: int) -> wp.Function:
    load_x, load_target = make_load(width, wp.float16), make_load(16, wp.float16)
    vec_out = wp.types.vector(16, float)

    @wp.func
    def sample(index: int, random: Stream, rows: Rows):
        return load_x(rows.x, index), vec_out(load_target(rows.target, index))

    return sample


@wp.func
def pixel(index: int, random: Stream, image: wp.array2d[wp.vec3]):
    numbers = uniform(random, 0)
    u, v = numbers[0], numbers[1]
    i = wp.min(int(v * float(image.shape[0])), image.shape[0] - 1)
    j = wp.min(int(u * float(image.shape[1])), image.shape[1] - 1)
    return wp.vec2(u, v), image[i, j]


def options(device: wp.Device) -> dict:
    precision = {"accumulation": "float16"} if device.is_cuda else {"precision": "float32"}
    return {**precision, "device": device}


def make_rows(config: Config, width: int, batch: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and targets, float16 [batch, width] and [batch, 16]."""
    x = np.random.default_rng(config.seed).uniform(-1, 1, (batch, width)).astype(np.float16)
    return x, np.sin(3 * x[:, :16].astype(np.float32) + x[:, :1]).astype(np.float16)


def row_trainer(config: Config, device: wp.Device, depth: int, width: int, batch: int, sample: wp.Function):
    """The trainer and a launch of the network alone, the gradient checked."""
    net = make_net(depth, width, seed=config.seed, dtype=wp.float16, **options(device))
    rows, (x, target) = Rows(), make_rows(config, width, batch)
    rows.x, rows.target = (wp.array(a, dtype=wp.float16, device=device) for a in (x, target))
    some = min(batch, 4096)
    checked = Trainer(net, sample=sample, data=rows, batch=some)
    expected = true_gradient(net, x[:some], target[:some].astype(np.float64))
    check(shape_name(depth, width), checked.gradient()[: net.spec.n_parameters], expected, 1e-2)
    kernel, y = make_evaluate_kernel(net.of_row, net.vec_out), wp.zeros((batch, 16), dtype=wp.float16, device=device)

    def forward() -> None:
        wp.launch(kernel, batch, [net.params, rows.x, y], device=device, block_dim=64)

    return Trainer(net, sample=sample, data=rows, batch=batch), forward


def encoded_net(config: Config, device: wp.Device, encoding: encodings.Encoding) -> MLP:
    width = 64 if device.is_cuda else 32
    return MLP(2, 3, width, 2, encoding=encoding, seed=config.seed, **options(device))


def image_trainer(net: MLP, batch: int) -> Trainer:
    device = net.device
    side = 1024 if device.is_cuda else 128
    y, x = np.mgrid[:side, : 2 * side] / side
    channels = [0.5 + 0.5 * np.sin(40 * x * y), 0.5 + 0.5 * np.cos(60 * x + 20 * y * y), (16 * x + 16 * y) % 2 < 1]
    image = wp.array(np.stack(channels, -1).astype(np.float32), dtype=wp.vec3, device=device)
    return Trainer(net, sample=pixel, data=image, batch=batch)


def measure_step(bench: Bench, row: str, trainer: Trainer, batch: int) -> None:
    def step() -> None:
        trainer.launches.gradient(0)
        trainer.launches.update()

    ms = bench.time(row, "step", step)
    bench.add(row, "samples", batch / ms / 1e3, "million/s")


def measure_parts(bench: Bench, row: str, trainer: Trainer, batch: int) -> None:
    measure_step(bench, row, trainer, batch)
    bench.time(row, "gradient", lambda: trainer.launches.gradient(0))
    encoding = trainer.net.encoding
    if not (encoding and encoding.sparse and encoding.n_parameters(trainer.net.n_in)):
        bench.time(row, "update", trainer.launches.update)


def measure(bench: Bench, shapes: list, encoded: dict, batches: tuple[int, ...]) -> None:
    config, device = bench.config, bench.device
    for depth, width in progress(shapes, config):
        sample = make_row_sample(width)
        for batch in batches:
            trainer, forward = row_trainer(config, device, depth, width, batch, sample)
            row = f"{shape_name(depth, width)}, {batch:,}"
            measure_parts(bench, row, trainer, batch)
            bench.time(row, "forward", forward)
            if device.is_cuda and batch in recorded.TINY_CUDA_NN_STEPS["2x32"] and width > 16 and not config.quick:
                net = make_net(depth, width, seed=config.seed, device="cpu")
                peers_cuda.measure_training(bench, net, *make_rows(config, width, batch))
    for name, encoding in progress(encoded.items(), config):
        for batch in batches:
            net = encoded_net(config, device, encoding)
            measure_parts(bench, f"{name}, {batch:,}", image_trainer(net, batch), batch)


def measure_course(bench: Bench) -> None:
    batch = 1 << 12
    for name, module in COURSE.items():
        net = module.make_network(seed=bench.config.seed, **options(bench.device))
        measure_step(bench, f"{name}, {batch:,}", image_trainer(net, batch), batch)


def measure_texture(bench: Bench) -> None:
    device, seed = bench.device, bench.config.seed
    size = texture.Size(1024, 1 << 14) if device.is_cuda else texture.Size(256, 1 << 12)
    codes = np.random.default_rng(seed).integers(0, 256, (1024, 1024, 3), dtype=np.uint8)
    picture = wp.array(codes, dtype=wp.vec3ub, device=device)
    for name in ("per_thread", "unfused", "float16"):
        version = texture.VERSIONS[name]
        net = texture.make_network(version, size, seed, device)
        trainer = Trainer(net, sample=texture.sample, data=picture, batch=size.batch, fused=version.fused)
        measure_step(bench, f"texture, {name}", trainer, size.batch)


def main(config: TrainingConfig) -> dict:
    bench = Bench("training", config)
    cuda = bench.device.is_cuda
    batches = (1 << 18, 1 << 16, 1 << 14) if cuda else (1 << 14, 1 << 12)
    batches = (config.batch,) if config.batch else batches[-1:] if config.quick else batches
    shapes, encoded = SHAPES if cuda else SHAPES[::3], ENCODINGS
    if config.quick:
        shapes, encoded = SHAPES[:1], {}
    bench.result.settings["precision"] = "float16, float16 sums" if cuda else "float32"
    measure(bench, shapes, encoded, batches)
    if not config.quick:
        measure_texture(bench)
    if cuda and not config.quick:
        measure_course(bench)
    for name, times in recorded.TINY_CUDA_NN_STEPS.items() if cuda else ():
        for batch, value in times.items():
            if batch in batches and bench.result.find(f"{name}, {batch:,}", "step"):
                bench.recorded(f"{name}, {batch:,}, tiny-cuda-nn", "step", value, "ms")
    for row, whose, value in recorded.OTHER_STEPS:
        if bench.result.find(row, "step"):
            bench.recorded(f"{row}, {whose}", "step", value, "ms")
    return bench.finish(steps)


if __name__ == "__main__":
    run(main, TrainingConfig)
