"""textured scene 3: only the tiles that the picture needs are decoded, into a cache of fixed size. Leaves step_03.png.

    python -m samples.textured_scene.step_03_on_feedback [--texture FILE.wntc] [--budget BYTES]

Step 2 decodes what nobody looks at. Here samples read a table of pages, mark those that they want, and take the finest
coarser level where one is not there yet; after each frame `update` decodes what was missing, and what was used least
recently leaves. So the picture is never without texture, at most blurred for a frame or two, and once all that it wants
is there it is the picture of step 2, to the last bit: `different_pixels` is 0 if the budget is large enough.

The last picture is that of a cache of a quarter of the size; step_03_tiles.png has what both missed and decoded in
each frame.
"""

import time
from dataclasses import dataclass

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.cli import Count
from warp_neural.samples.figures import save_figure
from warp_neural.samples.textured_scene.scene import camera_at, to_8_bit
from warp_neural.samples.textured_scene.step_02_on_load import RATE, Config, render_frames, renderer_of, save_sheet
from warp_neural.samples.textured_scene.texture import load_texture
from warp_neural.texture.measure import flip
from warp_neural.texture.texture import Texture
from warp_neural.texture.virtual import Update, VirtualTexture

MOST = 100  # frames until the cache must be warm, if its size allows it


@dataclass(frozen=True, kw_only=True)
class FeedbackConfig(Config):
    budget: Count | None = None
    """bytes of the cache; none: as many as the picture needs, found with a large one"""
    tile: Count = 32
    """texels a side"""


def needed(texture: Texture, config: FeedbackConfig) -> int:
    """Bytes of a cache that holds all that the camera's path wants, and the tables."""
    large = VirtualTexture(texture, budget=2**33, tile=config.tile)
    render_frames(renderer_of(large, config), config.frames, large.update)
    warm(large, config)
    return large.used_bytes


def warm(virtual: VirtualTexture, config: FeedbackConfig) -> wp.array:
    """Frames of the standing camera until nothing is missing; the last one's radiance."""
    renderer = renderer_of(virtual, config)
    for _ in range(MOST):
        radiance, _places = renderer.render(camera_at((config.frames - 1) / RATE))
        if virtual.update().misses == 0:
            break
    return radiance


def run(virtual: VirtualTexture, config: FeedbackConfig) -> tuple[np.ndarray, dict[str, float], list[Update]]:
    """The last frame of the moving camera, what it cost, and every frame's update."""
    updates, times = [], []

    def update() -> None:
        began = time.perf_counter()
        updates.append(virtual.update())
        wp.synchronize_device(virtual.texture.device)
        times.append(1e3 * (time.perf_counter() - began))

    picture, milliseconds = render_frames(renderer_of(virtual, config), config.frames, update)
    return picture, {"milliseconds": milliseconds, "milliseconds_of_update": float(np.median(times[1:]))}, updates


def main(config: FeedbackConfig) -> dict:
    texture = load_texture(config, cli.resolve_device(config.device))
    metrics, pictures = {}, {}
    for name, maps in (("on_sample", texture), ("on_load", wn.texture.CodedMaps(texture))):
        pictures[name], metrics[f"milliseconds_{name}"] = render_frames(renderer_of(maps, config), config.frames)
        metrics[f"bytes_{name}"] = maps.bytes
    budget, updates = config.budget or needed(texture, config), {}
    least = VirtualTexture(texture, budget, config.tile).least
    for name, share in (("on_feedback", 1), ("under_pressure", 4)):
        virtual = VirtualTexture(texture, max(budget // share, least), config.tile)
        pictures[name], costs, updates[name] = run(virtual, config)
        metrics |= {f"{cost}_{name}": value for cost, value in costs.items()} | {f"bytes_{name}": virtual.bytes}
        if share == 1:
            different = to_8_bit(warm(virtual, config)) != pictures["on_load"]
            metrics["different_pixels"] = int(different.any(axis=-1).sum())
        for count in ("misses", "decodes", "evictions"):
            metrics[f"{count}_{name}"] = sum(getattr(each, count) for each in updates[name])
    metrics |= {f"flip_{name}": flip(pictures["on_sample"], picture) for name, picture in pictures.items()}
    save_sheet(config, "step_03.png", pictures, metrics)
    save_curves(config, updates)
    return metrics


def save_curves(config: FeedbackConfig, updates: dict[str, list[Update]]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.2), layout="constrained")
    for axis, (name, each) in zip(figure.subplots(1, len(updates)), updates.items(), strict=True):
        axis.plot([update.wanted for update in each], label="wanted")
        axis.plot([update.misses for update in each], label="missed")
        axis.plot([update.decodes for update in each], label="decoded", linestyle="--")
        axis.set(title=name.replace("_", " "), xlabel="frame", ylabel="tiles")
        axis.legend()
    save_figure(config.out / "step_03_tiles.png", figure)


if __name__ == "__main__":
    cli.run(main, FeedbackConfig)
