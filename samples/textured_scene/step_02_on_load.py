"""textured scene 2: the texture decoded when it is loaded, into codes or block formats. Leaves step_02.png, DDS, KTX2.

    python -m samples.textured_scene.step_02_on_load [--texture FILE.wntc]

Step 1 keeps the texture small in memory and pays for it at every read. Decoded on load it is only small on disk, and a
read costs what a read of any texture costs. `fetch` is the same line for all: trilinear, from a texture's `sample`,
whether that evaluates the network, reads codes of 8 bits, or unpacks blocks of BC7 or BC1. The files are for programs
that have no network at all.

Milliseconds are those of a frame of the moving camera, the median; FLIP is against the picture of the network.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.cli import Count
from warp_neural.samples.figures import save_figure, show
from warp_neural.samples.textured_scene.fetch import make_exact_fetch
from warp_neural.samples.textured_scene.scene import Renderer, camera_at, to_8_bit
from warp_neural.samples.textured_scene.texture import Config as SceneConfig
from warp_neural.samples.textured_scene.texture import load_texture
from warp_neural.texture.measure import flip

RATE = 30  # frames a second


@dataclass(frozen=True, kw_only=True)
class Config(SceneConfig):
    frames: Count = 20
    """of the moving camera"""


def renderer_of(maps: Any, config: Config) -> Renderer:
    """maps: a neural texture, or anything that is read as one."""
    device = cli.resolve_device(config.device)
    return Renderer(make_exact_fetch(maps), maps.Params, maps.params, device, *config.size)


def render_frames(renderer: Renderer, frames: int, after: Callable[[], Any] = lambda: None) -> tuple[np.ndarray, float]:
    """The last frame, displayed, and milliseconds of a frame, the median. after: is called after each, not timed."""
    times = []
    for frame in range(-1, frames):  # the first one compiles
        began = time.perf_counter()
        radiance, _places = renderer.render(camera_at(max(frame, 0) / RATE))
        wp.synchronize_device(renderer.device)
        times.append(1e3 * (time.perf_counter() - began))
        after()
    return to_8_bit(radiance), float(np.median(times[1:]))


def main(config: Config) -> dict:
    texture = load_texture(config, cli.resolve_device(config.device))
    ways = {
        "on_sample": lambda: texture,
        "codes": lambda: wn.texture.CodedMaps(texture),
        "bc7": lambda: wn.texture.BlockMaps(texture),
        "bc1": lambda: wn.texture.BlockMaps(texture, bc1=True),
    }
    metrics, pictures = {}, {}
    for name, make in ways.items():
        began = time.perf_counter()
        maps = make()
        wp.synchronize_device(texture.device)
        metrics[f"seconds_to_load_{name}"] = time.perf_counter() - began
        pictures[name], metrics[f"milliseconds_{name}"] = render_frames(renderer_of(maps, config), config.frames)
        metrics[f"bytes_{name}"] = maps.bytes
        metrics[f"flip_{name}"] = flip(pictures["on_sample"], pictures[name])
        if name == "bc7":
            maps.save(config.out / "blocks", "dds")
            maps.save(config.out / "blocks", "ktx2")
    save_sheet(config, "step_02.png", pictures, metrics)
    return metrics


def save_sheet(config: SceneConfig, name: str, pictures: dict[str, np.ndarray], metrics: dict) -> None:
    """Pictures side by side, each with its cost."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2 * len(pictures), 3.4), layout="constrained")
    for axis, (title, picture) in zip(figure.subplots(1, len(pictures)), pictures.items(), strict=True):
        cost = f"{metrics[f'milliseconds_{title}']:.2f} ms, {metrics[f'bytes_{title}'] / 1e6:.2f} MB"
        show(axis, picture, f"{title.replace('_', ' ')}\n{cost}, FLIP {metrics[f'flip_{title}']:.4f}")
    save_figure(config.out / name, figure)


if __name__ == "__main__":
    cli.run(main, Config)
