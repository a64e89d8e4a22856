"""textured scene 1: every pixel reads one texel of a neural texture, by chance. Leaves step_01.png.

    python -m samples.textured_scene.step_01_on_sample [--texture FILE.wntc]

Filtering exactly takes eight texels and as many evaluations of the network. A texel that is drawn by its weight takes
one, and its mean is the filtered value (Fajardo et al. 2023, "Stochastic Texture Filtering"); averaged after shading it
is even the better one (Pharr et al. 2024, "Filtering After Shading With Stochastic Texture Filtering"). What is left is
noise, which is new in each frame: it boils. An average over the frames, with the camera's motion taken out, calms it,
and smooths outlines too, as each frame's rays are moved by a part of a pixel; textures are then filtered by less.

The camera moves slowly. Boiling is the deviation, over frames, of each pixel's error, so the picture's own motion does
not count; in 255ths of what is displayed, its root mean square. FLIP is that of the last frame. The reference has 64
rays a pixel into the texture's finest level. Expect, in 40 s on one CPU core and as long for compiling and training:

                  boiling, alone, accumulated     FLIP, alone, accumulated     ms a frame
    exact                  2.7            2.5           0.047        0.024          1,030
    bilinear               6.1            2.6           0.054        0.025            140
    bicubic                6.7            2.6           0.056        0.026            190
    gaussian               6.7            2.6           0.056        0.026            140
"""

import time
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.cli import Between
from warp_neural.samples.figures import save_figure, show
from warp_neural.samples.textured_scene.fetch import fetch_picture, make_exact_fetch, picture_of, vec7
from warp_neural.samples.textured_scene.scene import Renderer, camera_at, to_8_bit
from warp_neural.samples.textured_scene.temporal import Accumulator, jitter_of
from warp_neural.samples.textured_scene.texture import Config as SceneConfig
from warp_neural.samples.textured_scene.texture import load_texture
from warp_neural.texture.measure import flip
from warp_neural.texture.texture import Texture

SIDE = 8  # of the square of rays in a pixel of the reference
MEASURED = 8  # frames, the last ones
RATE = 30  # frames a second
SHARE = 0.25  # of a pixel's sides, that textures are filtered by in frames that are averaged: about 15 make a pixel


@dataclass(frozen=True, kw_only=True)
class Config(SceneConfig):
    frames: Annotated[int, Between(MEASURED, 10**5)] = 24
    """of the moving camera; the last eight are measured"""


def fetches(texture: Texture) -> dict[str, wp.Function]:
    filters = wn.texture.filters
    return {
        "exact": make_exact_fetch(texture),
        "bilinear": texture.make_sampler(filters.bilinear),
        "bicubic": texture.make_sampler(filters.bicubic),
        "gaussian": texture.make_sampler(filters.gaussian(0.5)),
    }


def sequence(config: Config, renderer: Renderer) -> tuple[dict[str, list[np.ndarray]], float]:
    """The last frames, displayed, alone and accumulated; milliseconds of a frame's rendering, the median."""
    alone, accumulated, times, accumulator = [], [], [], Accumulator()
    for frame in range(config.frames):
        camera = camera_at(frame / RATE)
        measured = frame >= config.frames - MEASURED
        if measured:
            began = time.perf_counter()
            radiance, _ = renderer.render(camera, seed=config.seed, frame=frame)
            wp.synchronize_device(renderer.device)
            times.append(1e3 * (time.perf_counter() - began))
            alone.append(to_8_bit(radiance))
        jitter = jitter_of(frame)
        radiance, places = renderer.render(camera, jitter=jitter, share=SHARE, seed=config.seed, frame=frame)
        mean = accumulator.add(camera, radiance, places, jitter)
        if measured:
            accumulated.append(to_8_bit(mean, renderer.device))
    return {"alone": alone, "accumulated": accumulated}, float(np.median(times))


def boiling(frames: list[np.ndarray], references: list[np.ndarray]) -> float:
    """In 255ths: the root mean square, over pixels, of the deviation of their errors over the frames."""
    return 255 * float(np.sqrt((np.array(frames, np.float64) - np.array(references)).var(axis=0).mean()))


def main(config: Config) -> dict:
    device = cli.resolve_device(config.device)
    texture = load_texture(config, device)
    truth = Renderer(fetch_picture, wp.array2d[vec7], picture_of(texture), device, *config.size)
    measured = range(config.frames - MEASURED, config.frames)
    references = [to_8_bit(truth.supersampled(camera_at(frame / RATE), SIDE), device) for frame in measured]
    metrics, pictures = {}, {}
    for name, fetch in fetches(texture).items():
        renderer = Renderer(fetch, texture.Params, texture.params, device, *config.size)
        found, metrics[f"milliseconds_{name}"] = sequence(config, renderer)
        for kind, frames in found.items():
            pictures[f"{name}, {kind}"] = frames[-1]
            metrics[f"boiling_{name}_{kind}"] = boiling(frames, references)
            metrics[f"flip_{name}_{kind}"] = flip(references[-1], frames[-1])
    save_sheet(config, pictures, references[-1], metrics)
    return metrics


def save_sheet(config: Config, pictures: dict[str, np.ndarray], reference: np.ndarray, metrics: dict) -> None:
    """A row of single frames, a row of accumulated ones, each beside the reference; the middle of each below."""
    from matplotlib.figure import Figure

    columns = len(pictures) // 2
    figure = Figure(figsize=(3.4 * (columns + 1), 8.6), layout="constrained")
    axes = figure.subplots(4, columns + 1)
    height, width = config.size
    middle = np.s_[height // 3 : height * 3 // 4, width // 4 : width * 2 // 3]
    for n, (title, picture) in enumerate([*pictures.items(), ("reference", reference), ("reference", reference)]):
        column, row = divmod(n, 2)
        name = title.replace(", ", "_")
        about = (
            f"\nboiling {metrics[f'boiling_{name}']:.2f}, FLIP {metrics[f'flip_{name}']:.4f}" if ", " in title else ""
        )
        show(axes[2 * row, column], picture, title + about)
        show(axes[2 * row + 1, column], picture[middle], "")
    save_figure(config.out / "step_01.png", figure)


if __name__ == "__main__":
    cli.run(main, Config)
