"""Pictures of the section: learned crops beside the reference, times as bars."""

from pathlib import Path

import numpy as np

from warp_neural.samples.figures import save_figure, save_picture

LABELS = {
    "per_thread": "per thread",
    "tiled": "tiled",
    "cooperative": "cooperative",
    "unfused": "cooperative,\nown kernels",
    "float32": "cooperative,\nfloat32",
    "float16": "cooperative,\nfloat16",
}


def save_crops(path: Path, crops: list[np.ndarray]) -> None:
    """8-bit sRGB crops side by side."""
    save_picture(path, np.concatenate(crops, axis=1) / np.float32(255))


def save_times(path: Path, charts: dict[str, dict[str, float]]) -> None:
    """One chart a title, of milliseconds a step on a logarithmic axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.6), layout="constrained")
    for axis, (title, times) in zip(figure.subplots(1, len(charts)), charts.items(), strict=True):
        bars = axis.bar([LABELS[name] for name in times], list(times.values()), color="tab:blue")
        slowest = max(times.values())
        axis.bar_label(bars, [f"{t:.3g} ms\n{slowest / t:.3g}x" for t in times.values()], padding=2)
        axis.set(title=title, ylabel="milliseconds a step", yscale="log")
        axis.set_ylim(0.5 * min(times.values()), 5 * slowest)
    save_figure(path, figure)
