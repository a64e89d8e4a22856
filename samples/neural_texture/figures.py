"""The curves of all steps in one picture, and crops of what each decodes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from warp_neural.samples.figures import save_figure, show
from warp_neural.samples.neural_texture.target import picture_of, shown_of
from warp_neural.samples.neural_texture.texture import Point
from warp_neural.texture.maps import TextureSet

CROP = 96  # texels


def gain(before: Sequence[Point], after: Sequence[Point]) -> float | None:
    """dB that a curve has more than another at equal bits, the mean over the logarithms of those that both have; none
    if there are none."""
    (x, y), (u, v) = (lines(points) for points in (before, after))
    low, high = max(x[0], u[0]), min(x[-1], u[-1])
    if low > high:
        return None
    common = np.linspace(low, high, 101)
    return float((np.interp(common, u, v) - np.interp(common, x, y)).mean())


def lines(points: Sequence[Point]) -> np.ndarray:
    """Logarithms of bits, rising, and dB. [2, points]"""
    return np.array(sorted((np.log2(point.bits), point.psnr) for point in points)).T


def save_curves(path: Path, curves: dict[str, list[Point]], gains: dict[str, float | None], ideas: dict) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 6), layout="constrained")
    axis = figure.subplots()
    for number, (name, points) in enumerate(curves.items()):
        x, y = lines(points)
        more = "" if gains.get(name) is None else f", {gains[name]:+.2f} dB"
        style = {"color": f"C{number}", "marker": "o"} if len(points) > 1 else {"color": "k", "marker": "*"}
        axis.plot(2**x, y, label=f"{ideas[name]}{more}", markersize=4 if len(points) > 1 else 12, **style)
    axis.set(xscale="log", xlabel="bits a texel, everything counted", ylabel="PSNR of all channels, dB")
    axis.set_title("gains over the curve before, in the mean of the bits that both have", fontsize=10)
    ticks = [2, 3, 4, 6, 8, 10]
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.grid(alpha=0.3)
    axis.legend()
    save_figure(path, figure)


def save_crops(path: Path, target: TextureSet, curves: dict[str, list[Point]], ideas: dict) -> None:
    """The middle of the maps, the original first, of each curve its point nearest to `target.SHOWN` bits."""
    from matplotlib.figure import Figure

    pictures = {f"original\n{8 * target.channels} bits": target.values}
    for name, points in curves.items():
        point = shown_of(points)
        pictures[f"{ideas[name]}\n{point.bits:.2f} bits, {point.psnr:.1f} dB"] = point.values
    crops = {title: picture_of(values, target, CROP) for title, values in pictures.items()}
    height, width = next(iter(crops.values())).shape[:2]
    figure = Figure(figsize=(1.9 * len(crops), 1.9 * height / width + 0.5), layout="constrained")
    for axis, (title, crop) in zip(figure.subplots(1, len(crops)), crops.items(), strict=True):
        show(axis, crop, title)
    save_figure(path, figure)
