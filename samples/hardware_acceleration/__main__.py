"""The main job: how much faster cooperative vectors train than plain per-thread arithmetic, with the same result.

    python -m samples.hardware_acceleration [--image FILE] [--device cuda]

First the course's small network in all three implementations, from the same weights on the same points. Then the
lecture's benchmark (speed-up there: over 3), a neural texture that learns a picture of 113 MB, or any given. `float32`
and `float16` do a whole step in one kernel; `unfused` only has the network in cooperative vectors, in the kernels that
`per_thread` uses, so it alone shows what they bring. On CUDA float32 networks are not fused, and use no tensor cores;
whole warps sum their gradients, though, where each thread of `per_thread` adds its own to memory.

Milliseconds are of whole steps: samples, loss, gradients, optimizer. PSNR is that of 2^18 random pixels as 8-bit sRGB.
The short runs of all versions end alike; the long ones compare a float16 network with a float32 one.

Sizes depend on the device: the CPU has a 256 x 256 texture, 4,096 pixels a step and 2,000 steps, which sees a fifth of
the picture's pixels once: expect blurred crops there. CUDA has 1024 x 1024, 16,384 and as many steps.

On one CPU core: the small network takes 1.78 (per thread), 0.84 (tiled) and 0.10 ms a step (cooperative), and
ends within 1e-6 of the same results; the texture 228 (per thread), 11.1 (unfused), 5.6 (float32) and 4.6 ms (float16).
After 2,000 steps float32 and float16 are both at 23.90 dB.

On an H200 the small network takes 0.45 (per thread), 0.16 (tiled) and 0.012 ms a step (cooperative), and ends within
0.001 of the same results; the texture 8.1 (per thread), 0.20 (unfused), 0.43 (float32) and 0.089 ms (float16). After
2,000 steps float32 and float16 are both at 28.19 dB.
"""

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import warp as wp

from warp_neural import cli
from warp_neural.cli import CommonConfig
from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path
from warp_neural.samples.hardware_acceleration.figures import save_crops, save_times
from warp_neural.samples.hardware_acceleration.picture import load_picture
from warp_neural.samples.hardware_acceleration.small_network import compare, warm_up
from warp_neural.samples.hardware_acceleration.texture import VERSIONS, Size, crop, psnr, train

LONG = ("float32", "float16")  # the versions that the long runs compare


@dataclass(frozen=True, kw_only=True)
class Config(CommonConfig):
    out: Path = Path("out/hardware_acceleration")
    """folder for pictures and files"""
    image: Path | None = None
    """picture to learn; none: 6144 x 6144 pixels (113 MB), tiles of photographs that scikit-image carries"""
    side: Annotated[int, cli.Between(1, 2**15)] = 6144
    """pixels along one side of the picture of tiles"""
    small_steps: cli.Count = 1000
    """steps of the small network"""
    small_batch: cli.Samples | None = None
    """points a step of the small network; none: 1024 on the CPU, 4096 on CUDA, as in the course"""
    latents: cli.Side | None = None
    """texels along one side of the neural texture; none: 256 on the CPU, 1024 on CUDA"""
    batch: cli.Samples | None = None
    """pixels a step; none: 4096 on the CPU, 16384 on CUDA"""
    short: cli.Count | None = None
    """steps of the short runs, of all versions; none: 32 on the CPU, 64 on CUDA"""
    steps: cli.Count = 2000
    """steps of the long runs, of float32 and float16"""


def main(config: Config) -> dict:
    began = time.perf_counter()
    device = cli.resolve_device(config.device)
    cuda = device.is_cuda
    short = config.short or (64 if cuda else 32)
    size = Size(config.latents or (1024 if cuda else 256), config.batch or (16384 if cuda else 4096))
    small_batch = config.small_batch or (4096 if cuda else 1024)
    check({"small_steps": config.small_steps, "short": short, "steps": config.steps}, device)
    with atomic_path(config.out / "config.json") as path:  # a folder that cannot be written fails now
        path.write_text(json.dumps(asdict(config), indent=2, default=str) + "\n")

    metrics = compare(config.small_steps, small_batch, config.seed, device, config.json)
    picture = load_picture(config.image, config.side, config.seed)
    pixels = wp.array(picture, dtype=wp.vec3ub, device=device)
    for name, version in VERSIONS.items():
        net, step = train(version, size, short, pixels, config.seed, config.json)
        metrics |= {f"texture_milliseconds_{name}": 1e3 * step, f"texture_psnr_short_{name}": psnr(net, picture)}
    crops = []
    for name in LONG:
        net, step = train(VERSIONS[name], size, config.steps, pixels, config.seed, config.json)
        metrics |= {f"texture_milliseconds_{name}": 1e3 * step, f"texture_psnr_{name}": psnr(net, picture)}
        reference, learned = crop(net, picture, 512)
        crops.append(learned)
    for name in list(VERSIONS)[1:]:
        ratio = metrics["texture_milliseconds_per_thread"] / metrics[f"texture_milliseconds_{name}"]
        metrics[f"texture_speedup_{name}"] = ratio
    save_crops(config.out / "crops.png", [reference, *crops])
    charts = {f"4-16-4, {small_batch} points": "small_milliseconds_"}
    charts[f"neural texture, {size.channels}-{size.width}-{size.width}-3, {size.batch} pixels"] = (
        "texture_milliseconds_"
    )
    save_times(config.out / "times.png", {title: starting(metrics, prefix) for title, prefix in charts.items()})
    metrics |= {"picture_megabytes": picture.nbytes / 1e6, "latents": size.latents, "batch": size.batch}
    metrics |= {"steps": config.steps, "device": device.name if cuda else "cpu"}
    metrics |= {"seconds_total": time.perf_counter() - began}
    return metrics


def check(runs: dict[str, int], device: wp.Device) -> None:
    for option, steps in runs.items():
        if steps <= warm_up(device):
            raise InputError(f"--{option.replace('_', '-')} {steps}: give more than the {warm_up(device)} to warm up")


def starting(metrics: dict, prefix: str) -> dict[str, float]:
    return {key.removeprefix(prefix): value for key, value in metrics.items() if key.startswith(prefix)}


if __name__ == "__main__":
    cli.run(main, Config)
