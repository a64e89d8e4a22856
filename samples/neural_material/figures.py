"""What the sample leaves in its folder."""

from pathlib import Path

import numpy as np

from warp_neural.samples.figures import save_figure, show

LABELS = {
    "naive": "naive: texture and network",
    "encoder": "encoder, baked and tuned",
    "frames": "encoder with frames",
    "reference": "reference",
}


def save_sheet(path: Path, pictures: dict[str, np.ndarray], metrics: dict) -> None:
    """Displayed pictures `[height, width, 3]` side by side, below each its absolute difference (times 2)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * len(pictures), 7.0), layout="constrained")
    axes = figure.subplots(2, len(pictures))
    for column, (name, picture) in enumerate(pictures.items()):
        error = metrics.get(f"error_{name}")
        show(axes[0, column], picture, LABELS[name] + (f"\nerror {error:.3f}" if error is not None else "\n"))
        difference = 2 * np.abs(picture - pictures["reference"])
        if name == "reference":
            axes[1, column].axis("off")
            dial = "\n".join(f"{size}: {metrics[f'error_{size}']:.3f}" for size in ("2x16", "2x32", "3x64"))
            axes[1, column].text(0, 0.95, f"Below each: difference x 2.\n\nErrors of decoders:\n{dial}", va="top")
        else:
            show(axes[1, column], difference, "")
    save_figure(path, figure)
