"""Speed and error by precision: `python -m perf.precision`; a network trained in float32 shows a photograph.

2 inputs, frequency encoding (8 octaves), 2x64 (CPU: 2x32), RGB, trained on the CPU on scikit-image's `astronaut`; its
weights then go to networks of every precision. `picture`: milliseconds of all its pixels, the encoding included;
`PSNR`: against the photograph; `error`: against the same weights in float64, relative. The PNG shows each picture.
`trained`: PSNR of 2x32 after half as many steps of a quarter of the samples, the same in float32 and in float16.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import warp as wp

from perf.measure import Bench, Config, check
from perf.networks import LIMITS, truth
from perf.training import pixel
from warp_neural import MLP, Trainer, encodings
from warp_neural.cli import Between, progress, run
from warp_neural.imaging.image import displayed_psnr
from warp_neural.train import optim

KINDS = [
    ("float32", "float32"),
    ("tf32", "float32"),
    ("float16", "float32"),
    ("float16", "float16"),
    ("bfloat16", "float32"),
    ("e4m3", "float16"),
    ("e5m2", "float16"),
    ("int8", "float32"),
]
OCTAVES = 8


@dataclass(frozen=True, kw_only=True)
class PrecisionConfig(Config):
    steps: Annotated[int, Between(0, 10**6)] = 0
    """of training; 0: 2,000, or 200 with --quick"""


def make_picture_kernel(net: MLP):
    func = net.func

    @wp.kernel(module="unique", enable_backward=False)
    def picture_kernel(params: net.Params, size: int, y: wp.array[wp.vec3]):
        i = wp.tid()
        x = wp.vec2((float(i % size) + 0.5) / float(size), (float(i / size) + 0.5) / float(size))
        y[i] = func(params, x)

    return picture_kernel


def photograph(size: int) -> np.ndarray:
    """Displayed values in [0, 1], [size, size, 3]."""
    from skimage.data import astronaut

    image = astronaut().astype(np.float32) / 255
    return image.reshape(size, 512 // size, size, 512 // size, 3).mean((1, 3))


def encode(x: np.ndarray) -> np.ndarray:
    """As `encodings.Frequency(OCTAVES)` does, [n, 2] to [n, 32], float64."""
    angles = np.pi * x.astype(np.float64)[:, :, None] * 2.0 ** np.arange(OCTAVES)
    return np.stack([np.sin(angles), np.cos(angles)], -1).reshape(len(x), -1)


def make(config: Config, device: wp.Device, width: int, precision: str, accumulation: str) -> MLP:
    options = {"precision": precision, "accumulation": accumulation, "device": device, "seed": config.seed}
    return MLP(2, 3, width, 2, encoding=encodings.Frequency(OCTAVES), **options)


def draw(pictures: dict[str, np.ndarray]):
    from matplotlib.figure import Figure

    columns = min(len(pictures), 5)
    rows = -(-len(pictures) // columns)
    canvas = Figure(figsize=(2 * columns, 2.4 * rows), layout="constrained")
    axes = canvas.subplots(rows, columns, squeeze=False).ravel()
    for ax in axes:
        ax.axis("off")
    for ax, (name, picture) in zip(axes, pictures.items(), strict=False):
        ax.imshow(np.clip(picture, 0, 1))
        ax.set_title(name, fontsize=7)
    return canvas


def measure_trained(bench: Bench, image: np.ndarray, steps: int, batch: int) -> None:
    device, size, found = bench.device, len(image), {}
    data = wp.array(image, dtype=wp.vec3, device=device)
    for precision in ("float32", "float16"):
        net = make(bench.config, device, 32, precision, "float32")
        optimizer = optim.Adam(lr=2e-3)
        Trainer(net, sample=pixel, data=data, optimizer=optimizer, batch=batch, seed=0).run(steps, quiet=True)
        y = wp.zeros(size * size, dtype=wp.vec3, device=device)
        wp.launch(make_picture_kernel(net), y.size, [net.params, size, y], device=device)
        found[precision] = displayed_psnr(image, np.clip(y.numpy().reshape(image.shape), 0, 1))
        bench.add(f"{precision}, float32 sums", "trained", found[precision], "dB")
    bench.add("float16 under float32", "trained", found["float32"] - found["float16"], "dB")


def main(config: PrecisionConfig) -> dict:
    bench = Bench("precision", config, block=256)
    device = bench.device
    size, width, batch = (512, 64, 1 << 12) if device.is_cuda else (128, 32, 1 << 12)
    steps = config.steps or (200 if config.quick else 2000)
    bench.result.settings |= {"training": f"{steps:,} steps of {batch:,} in float32", "pixels": f"{size * size:,}"}
    image = photograph(size)
    trained = make(config, wp.get_device("cpu"), width, "float32", "float32")
    data = wp.array(image, dtype=wp.vec3, device="cpu")
    Trainer(trained, sample=pixel, data=data, optimizer=optim.Adam(lr=2e-3), batch=batch).run(steps, quiet=config.json)
    i = np.arange(size * size)
    x = np.stack([(i % size + 0.5) / size, (i // size + 0.5) / size], 1).astype(np.float32)
    exact, pictures = truth(trained, encode(x)), {"photograph": image}
    for precision, accumulation in progress(KINDS[:1] + KINDS[3:4] + KINDS[7:] if config.quick else KINDS, config):
        net = make(config, device, width, precision, accumulation)
        net.weights, net.biases = trained.weights, trained.biases
        if precision == "int8":
            net.calibrate(x[:: max(1, len(x) // 1024)])
        kernel, y = make_picture_kernel(net), wp.zeros(len(x), dtype=wp.vec3, device=device)
        launch = lambda: wp.launch(kernel, len(x), [net.params, size, y], device=device)  # noqa: B023, E731
        launch()
        shown, row = y.numpy().copy(), f"{precision}, {accumulation} sums"
        check(row, shown, exact, ERRORS[precision])
        bench.time(row, "picture", launch)
        picture = shown.reshape(image.shape)
        psnr = displayed_psnr(image, np.clip(picture, 0, 1))
        bench.add(row, "PSNR", psnr, "dB")
        bench.add(row, "error", float(np.linalg.norm(shown - exact) / np.linalg.norm(exact)), "")
        pictures[f"{row}\n{psnr:.2f} dB"] = picture
    measure_trained(bench, image, steps // 2, batch // 4)
    return bench.finish(lambda result: draw(pictures))


# a trained network's weights are larger than random ones: what nobody would call a rounding error stops the measurement
ERRORS = {
    **{name: 10 * limit for name, limit in LIMITS.items()},
    "float32": 1e-3,
    "tf32": 0.02,
    "e5m2": 1.0,
    "int8": 0.5,
}

if __name__ == "__main__":
    run(main, PrecisionConfig)
