"""All figures of a comparison of codecs, and where we lose, as a page in Markdown."""

from collections.abc import Iterable

from perf.texture_points import Point
from perf.texture_rivals import Rival


def page(material: str, made_on: str, points: list[Point], lost: list[Rival]) -> str:
    measures = list(dict.fromkeys(measure for point in points for measure in point.figures))
    rows = [
        (p.codec, p.setting, number(p.bits), *(number(p.figures[m]) if m in p.figures else "" for m in measures))
        for p in points
    ]
    head = [f"# {material}", "", f"Our files were made on {made_on}.", ""]
    return "\n".join([*head, *table(("codec", "setting", "bits", *measures), rows), "", *losses_section(lost)])


def losses_section(lost: list[Rival]) -> list[str]:
    """The table of where another codec is ahead, in lines."""
    equal = [each for each in lost if each.its_bits == each.bits]
    larger = [each for each in lost if each.its_bits > each.bits]
    lines = ["## Where we lose", "", "At equal bits:" + ("" if equal else " never."), ""]
    if equal:
        head = "measure", "bits", "codec", "its figure", "ours", "behind by"
        rows = [(r.measure, number(r.bits), r.codec, *map(number, (r.its, r.ours, r.behind))) for r in equal]
        lines += table(head, rows)
    if larger:
        lines += ["", "Our largest file to block formats, which are larger:", ""]
        head = "measure", "format", "its bits", "our bits", "its figure", "ours", "behind by"
        lines += table(
            head, [(r.measure, r.codec, *map(number, (r.its_bits, r.bits, r.its, r.ours, r.behind))) for r in larger]
        )
    return lines


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    head = tuple(head)
    return [f"| {' | '.join(cells)} |" for cells in (head, ("---",) * len(head), *rows)]


def number(value: float) -> str:
    return f"{value:.2f}" if abs(value) >= 1.5 else f"{value:.4f}"
