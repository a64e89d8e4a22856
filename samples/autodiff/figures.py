"""The picture that step 5 leaves."""

from pathlib import Path

import numpy as np

from warp_neural.imaging.image import linear_to_srgb
from warp_neural.samples.figures import save_figure, show


def save_sheet(
    path: Path,
    colors: np.ndarray,
    normals: np.ndarray,
    hit: np.ndarray,
    solid: np.ndarray,
    errors: dict[str, np.ndarray],
) -> None:
    """Linear colours and unit normals `[height, width, 3]`; errors in degrees `[height, width]`, means in `solid`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 8), layout="constrained")
    axes = figure.subplots(2, 2)
    show(axes[0, 0], linear_to_srgb(np.clip(colors, 0, 1)), "shaded with normals by forward mode")
    show(axes[0, 1], np.where(hit[..., None], normals * 0.5 + 0.5, 1), "normals by forward mode")
    steps = {name: error for name, error in errors.items() if name != "forward"}
    best = min(steps, key=lambda name: steps[name][solid].mean())
    title = f"forward mode: mean error {errors['forward'][solid].mean():.1e}°"
    _show_error(axes[1, 0], errors["forward"], hit, title)
    title = f"central differences, best step {best.removeprefix('h_')}: mean error {steps[best][solid].mean():.1e}°"
    shown = _show_error(axes[1, 1], steps[best], hit, title)
    figure.colorbar(shown, ax=axes[1, :], label="log10 of the error in degrees", shrink=0.8)
    save_figure(path, figure)


def _show_error(axis, error: np.ndarray, hit: np.ndarray, title: str):
    shown = show(axis, np.where(hit, np.log10(np.maximum(error, 1e-12)), np.nan), title)
    shown.set(cmap="magma", clim=(-6, 1))
    return shown
