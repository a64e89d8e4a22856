"""What the sample leaves in its folder: pictures, curves, maps."""

from pathlib import Path

import numpy as np

from warp_neural.imaging.exr import save_exr
from warp_neural.imaging.image import save_image
from warp_neural.samples.figures import save_figure, show
from warp_neural.samples.mipmap.maps import Maps

LABELS = {"box": "box filter", "toksvig": "Toksvig", "sgd": "SGD, course's gradients", "adam": "learned (Adam)"}
NOTE = """Light (0.2, 0.2, 1), seen from above.

Figures: mean squared error over random
lights and views, of radiance (linear)
and of displayed values (display).

Below each: absolute error x 2."""
COLORS = {"box": "tab:gray", "toksvig": "tab:olive", "sgd": "tab:orange", "adam": "tab:blue"}


def save_comparison(path: Path, truth: np.ndarray, pictures: dict[str, np.ndarray], metrics: dict) -> None:
    """Displayed pictures `[height, width, 3]` beside the truth, the absolute error of each (times 2) below it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * (1 + len(pictures)), 7.4), layout="constrained")
    axes = figure.subplots(2, 1 + len(pictures))
    show(axes[0, 0], truth, "reference\nshaded in full resolution, then averaged")
    axes[1, 0].axis("off")
    axes[1, 0].text(0, 0.95, NOTE, va="top")
    for column, (name, picture) in enumerate(pictures.items(), start=1):
        figures = f"linear {metrics[f'linear_{name}']:.3g}   display {metrics[f'display_{name}']:.3g}"
        show(axes[0, column], picture, f"{LABELS[name]}\n{figures}")
        show(axes[1, column], np.clip(2 * np.abs(picture - truth), 0, 1), f"error of {LABELS[name]}")
    save_figure(path, figure)


def save_curves(path: Path, curves: dict[str, np.ndarray]) -> None:
    """Curves `[points, 3]` of step, linear and displayed error; where each begins is its classical start."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.2), layout="constrained")
    starts = {"sgd": "box", "adam": "toksvig"}
    for column, (axis, title) in enumerate(zip(figure.subplots(1, 2), ("linear", "display"), strict=True), start=1):
        for name, curve in curves.items():
            axis.plot(curve[:, 0], curve[:, column], label=LABELS[name], color=COLORS[name])
            start = starts[name]
            axis.axhline(curve[0, column], label=LABELS[start], color=COLORS[start], linestyle="--")
        axis.set(title=f"{title} error on held-out pairs", xlabel="step", ylabel="mean squared error", yscale="log")
        axis.grid(alpha=0.3)
        axis.legend()
    save_figure(path, figure)


def save_maps(folder: Path, maps: Maps) -> None:
    """Every map as a 16-bit PNG in `folder`, named as `load_material` reads them, and all together in `maps.exr`."""
    for name, image in maps.arrays().items():
        stored = image * 0.5 + 0.5 if name == "normal" else image
        save_image(folder / f"{name}.png", stored, color_space="srgb" if name == "albedo" else "linear", bits=16)
    save_exr(folder / "maps.exr", dict(zip(CHANNELS, np.moveaxis(stacked(maps), -1, 0), strict=True)))


CHANNELS = ("R", "G", "B", "normal.X", "normal.Y", "normal.Z", "roughness", "metalness", "specular")


def stacked(maps: Maps) -> np.ndarray:
    """`[height, width, 9]`, in the order of CHANNELS."""
    images = [image if image.ndim == 3 else image[..., None] for image in maps.arrays().values()]
    return np.concatenate(images, axis=-1)
