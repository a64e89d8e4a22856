"""Codecs against ours at equal bits: who is ahead, where, and by how much."""

from dataclasses import dataclass

import numpy as np

from perf.texture_peers import BLOCKS
from perf.texture_points import OURS, Point, higher_is_better

REACH = 1.03  # times beyond its points a line goes on straight: wanted sizes are met within 3 %


@dataclass(frozen=True)
class Rival:
    """Another codec's figure beside ours.

    bits: of ours. its_bits: the same, but for block formats, each of which has one size: where that is beyond our
    largest file, our largest file stands beside it.
    """

    measure: str
    codec: str
    bits: float
    its_bits: float
    ours: float
    its: float

    @property
    def behind(self) -> float:
        """By how much ours is worse; negative where it is better."""
        return self.its - self.ours if higher_is_better(self.measure) else self.ours - self.its


def between(curve: list[Point], measure: str, bits: float) -> float | None:
    """A codec's figure at `bits`, its points joined over the logarithm of bits; None where they do not reach."""
    points = sorted((point.bits, point.figures[measure]) for point in curve if measure in point.figures)
    if not points or not points[0][0] / REACH <= bits <= points[-1][0] * REACH:
        return None
    if len(points) == 1:
        return points[0][1]
    x, y = np.log([bits for bits, _ in points]), [figure for _, figure in points]
    k = int(np.clip(np.searchsorted(x, np.log(bits)), 1, len(points) - 1))
    return float(y[k - 1] + (y[k] - y[k - 1]) * (np.log(bits) - x[k - 1]) / (x[k] - x[k - 1]))


def others(points: list[Point]) -> dict[str, list[Point]]:
    """The points of each other codec; a block format by itself, as a point a setting."""
    curves = {}
    for point in points:
        if point.codec != OURS:
            curves.setdefault(point.setting if point.codec == BLOCKS else point.codec, []).append(point)
    return curves


def rivals(points: list[Point]) -> list[Rival]:
    """At the bits of each of our files, all other codecs, their points joined; block formats at their own bits."""
    ours = sorted((point for point in points if point.codec == OURS), key=lambda point: point.bits)
    found = []
    for codec, curve in others(points).items() if ours else ():
        block = curve[0].codec == BLOCKS
        for bits in [min(curve[0].bits, ours[-1].bits)] if block else [point.bits for point in ours]:
            its_bits = curve[0].bits if block else bits
            for measure in curve[0].figures:
                here, there = between(ours, measure, bits), between(curve, measure, its_bits)
                if here is not None and there is not None:
                    found.append(Rival(measure, codec, bits, its_bits, here, there))
    return found


def best_at_equal_bits(found: list[Rival]) -> dict[str, list[Rival]]:
    """By measure, the best other codec at the bits of each of our files."""
    best = {}
    for each in found:
        key = each.measure, each.bits
        if each.its_bits == each.bits and (key not in best or each.behind > best[key].behind):
            best[key] = each
    measures = dict.fromkeys(measure for measure, _ in best)
    return {m: sorted((r for (name, _), r in best.items() if name == m), key=lambda r: r.bits) for m in measures}


def losses(found: list[Rival]) -> list[Rival]:
    """Where another codec is ahead."""
    lost = [each for each in found if each.behind > 0]
    return sorted(lost, key=lambda each: (each.its_bits > each.bits, each.measure, each.bits, -each.behind))
