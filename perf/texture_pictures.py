"""Curves of all codecs, and crops of a material's maps side by side."""

import numpy as np

from perf.texture_peers import BLOCKS, Coded, Maps
from perf.texture_points import OURS, RTXNTC, Judge, Point, higher_is_better

CROP, ENLARGED = 96, 4  # texels of a crop's side, pixels of a texel's
LINE = 20  # of text, in pixels
COLORS = {OURS: "C0", RTXNTC: "C1", "AVIF": "C2", "WebP": "C4", "JPEG": "C5", BLOCKS: "C3", "smaller": "C7"}
SHOWN = [(BLOCKS, "BC7, BC4", 24), *((codec, None, bits) for bits in (1, 2, 4) for codec in (OURS, "AVIF"))]
"""Side by side: codec, setting or None, about how many bits a texel."""
ABOUT = 1.4  # times more or fewer


def curves(points: list[Point], material: str):
    """A panel for each measure, all codecs over the logarithm of bits; blocks as single points."""
    from matplotlib.figure import Figure

    measures = list(dict.fromkeys(measure for point in points for measure in point.figures))
    columns = 4
    rows = -(-len(measures) // columns)
    figure = Figure(figsize=(4.5 * columns, 3.4 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(measures) :]:
        axis.axis("off")
    for axis, measure in zip(axes, measures, strict=False):
        panel(axis, points, measure)
    figure.suptitle(material)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def panel(axis, points: list[Point], measure: str) -> None:
    points = [point for point in points if measure in point.figures]
    for codec in dict.fromkeys(point.codec for point in points):
        shown = sorted((point.bits, point.figures[measure]) for point in points if point.codec == codec)
        bare = codec == BLOCKS
        style = {"linewidth": 2.5 if codec == OURS else 1, "linestyle": "none" if bare else "-"}
        axis.plot(
            *zip(*shown, strict=True), "s" if bare else "o", markersize=4, color=COLORS[codec], label=codec, **style
        )
    errors = not higher_is_better(measure) and all(point.figures[measure] > 0 for point in points)
    axis.set(title=measure, xscale="log", xlabel="bits a texel", yscale="log" if errors else "linear")
    axis.set_xticks([0.25, 0.5, 1, 2, 4, 8, 16, 32], ["¼", "½", "1", "2", "4", "8", "16", "32"])
    axis.set_xticks([], minor=True)
    axis.grid(alpha=0.3)


def side_by_side(coded: list[tuple[Coded, Point]]) -> list[tuple[Coded, Point]]:
    """What SHOWN names, where it is there."""
    chosen = []
    for codec, setting, bits in SHOWN:
        found = [pair for pair in coded if pair[0].codec == codec and setting in (None, pair[0].setting)]
        nearest = min(found, key=lambda pair: abs(np.log(pair[1].bits / bits)), default=None)
        if nearest and (setting or 1 / ABOUT < nearest[1].bits / bits < ABOUT):
            chosen.append(nearest)
    return chosen


def title(point: Point) -> str:
    codec = point.setting if point.codec == BLOCKS else point.codec
    return f"{codec}, {point.bits:.2f} bits, {point.figures['PSNR']:.1f} dB"


def crops(maps: Maps, chosen: list[tuple[Coded, Point]]) -> np.ndarray:
    """The middle of each map, a row each, enlarged: the original, then others; uint8 [height, width, 3]."""
    columns = [column("original", maps), *(column(title(point), coded.maps) for coded, point in chosen)]
    return np.concatenate(columns, axis=1)


def column(title: str, maps: Maps) -> np.ndarray:
    from PIL import Image, ImageDraw

    cells = []
    for pixels in maps.values():
        top, left = (max(side - CROP, 0) // 2 for side in pixels.shape[:2])
        cell = np.repeat(pixels[top : top + CROP, left : left + CROP], 3 // pixels.shape[2], axis=2)
        cells.append(np.pad(cell.repeat(ENLARGED, 0).repeat(ENLARGED, 1), ((0, 2), (0, 2), (0, 0))))
    heading = Image.new("RGB", (cells[0].shape[1], LINE), "white")
    ImageDraw.Draw(heading).text((2, 1), title, fill="black", font_size=LINE - 5)
    return np.concatenate([np.asarray(heading), *cells])


def spheres(judge: Judge, chosen: list[tuple[Coded, Point]]):
    """The sphere with the original maps and with others, on one sheet."""
    from matplotlib.figure import Figure

    columns = 4
    rows = -(-(1 + len(chosen)) // columns)
    figure = Figure(figsize=(6 * columns, 6.3 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes:
        axis.axis("off")
    axes[0].imshow(np.clip(judge.sphere, 0, 1))
    axes[0].set_title("original", fontsize=9)
    for axis, (coded, point) in zip(axes[1:], chosen, strict=False):
        axis.imshow(np.clip(judge.rendered(coded.maps), 0, 1))
        axis.set_title(f"{title(point)}, FLIP {point.figures['sphere FLIP']:.3f}", fontsize=9)
    return figure
