"""What the sample leaves in its folder: the lit spheres, the sheet over roughness and light."""

from pathlib import Path

import numpy as np

from warp_neural.imaging.image import linear_to_srgb
from warp_neural.samples.figures import save_figure, show


def save_spheres(path: Path, analytic: np.ndarray, neural: np.ndarray, gain: float, title: str) -> None:
    """Displayed pictures [size, size, 3], and their difference times `gain`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.4), layout="constrained")
    axes = figure.subplots(1, 3)
    show(axes[0], analytic, "analytic: Disney BRDF")
    show(axes[1], neural, "neural: 30-32-32-32-4")
    show(axes[2], gain * np.abs(neural - analytic), f"difference x {gain:g}")
    figure.suptitle(title, fontsize=10)
    save_figure(path, figure)


def save_sheet(path: Path, pictures: np.ndarray, roughness: np.ndarray, angles: np.ndarray, gain: float) -> None:
    """Pictures [analytic and neural, roughness, angles, size, size, 3]; angles in degrees."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 13 / 2 * len(roughness) / len(angles) + 0.9), layout="constrained")
    axes = figure.subplots(1, 2)
    size = pictures.shape[3]
    for axis, cells, title in (
        (axes[0], pictures[1], "neural"),
        (axes[1], gain * np.abs(pictures[1] - pictures[0]), f"difference to analytic x {gain:g}"),
    ):
        rows = np.concatenate(np.moveaxis(cells, 2, 1).reshape(len(roughness), size, -1, 3))
        axis.imshow(np.clip(rows, 0, 1), interpolation="nearest")
        axis.set_title(title, fontsize=10)
        axis.set_xticks((np.arange(len(angles)) + 0.5) * size, [f"{angle:.0f}°" for angle in angles])
        axis.set_yticks((np.arange(len(roughness)) + 0.5) * size, [f"{r:.2f}" for r in roughness])
        axis.set_xlabel("angle between light and view")
        axis.set_ylabel("roughness")
        axis.spines[:].set_visible(False)
    save_figure(path, figure)


def save_fits(path: Path, truth: np.ndarray, fits: dict[str, np.ndarray], metrics: dict[str, dict]) -> None:
    """Linear pictures beside the truth, and twice the error of what is displayed below each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * (1 + len(fits)), 6.9), layout="constrained")
    axes = figure.subplots(2, 1 + len(fits))
    truth = linear_to_srgb(truth)
    show(axes[0, 0], truth, "image")
    axes[1, 0].axis("off")
    axes[1, 0].text(0, 0.95, "Below each: error x 2.", va="top")
    for column, (name, fit) in enumerate(fits.items(), start=1):
        fit = linear_to_srgb(fit)
        title = f"{name}\n{metrics[name]['psnr']:.2f} dB, {metrics[name]['parameters']} parameters"
        show(axes[0, column], fit, title)
        show(axes[1, column], 2 * np.abs(fit - truth), "")
    save_figure(path, figure)
