"""What a newcomer should choose, read off the results."""

from collections.abc import Iterator

from perf.results import Figure, Result

CLOSE = 0.95  # of the best speed: the first choice that reaches it will do


def advice(results: dict[str, Result]) -> list[str]:
    lines = []
    for name, speak in (
        ("inference", precision), ("precision", accuracy), ("layout", layout), ("fusion", fusion), ("inference", block),
        ("inference", batch), ("training", training_batch), ("divergence", sharing),
    ):  # fmt: skip
        if name in results:
            lines += speak(results[name])
    return lines or ["Nothing yet: measure `inference`, `precision`, `layout` and `training`."]


def fastest(figures: list[Figure]) -> Figure:
    return max(figures, key=lambda figure: figure.value)


def speeds(result: Result, column: str, prefix: str = "") -> list[Figure]:
    """Measured speeds of networks in a column."""
    found = [f for f in result.rows(column) if "FLOP/s" in f.unit and not f.recorded and f.row.startswith(prefix)]
    return [f for f in found if prefix or "sums" in f.row]


def columns(result: Result) -> Iterator[str]:
    yield from (name for name in ("2x32", "3x64") if result.rows(name))


def precision(result: Result) -> list[str]:
    lines = []
    for column in columns(result):
        found = sorted(speeds(result, column), key=lambda figure: -figure.value)
        listed = "; ".join(f"{f.row} {f.value:.3g}" for f in found[:4])
        if found:
            lines.append(f"**Precision**, {column}, {found[0].unit}, fastest first: {listed}.")
    return lines


def accuracy(result: Result) -> list[str]:
    rows = result.rows("PSNR")
    exact = next((f for f in rows if f.row.startswith("float32")), None)
    if exact is None:
        return []
    lost = ", ".join(f"{f.row} {exact.value - f.value:.2f}" for f in rows if f is not exact)
    return [f"Its price, dB of a picture lost against float32 ({exact.value:.1f} dB): {lost}."]


def layout(result: Result) -> list[str]:
    best = fastest(result.figures)
    others = ", ".join(f"{f.row} {f.value / best.value:.2f}" for f in result.figures if f is not best)
    return [f"**Layout** of single operations: {best.row}; of its speed have {others}. `wn.MLP` packs its own."]


def fusion(result: Result) -> list[str]:
    fused = next((f for f in result.figures if f.row == "fused"), None)
    if fused is None:
        return []
    others = ", ".join(f"{f.row} {f.value / fused.value:.2g}" for f in result.figures if f is not fused)
    return [f"**Whole networks** (`wn.MLP`) rather than single operations: of its speed have {others}."]


def sizes(result: Result, column: str, prefix: str) -> list[Figure]:
    return sorted(speeds(result, column, prefix), key=lambda figure: int(figure.row.split()[-1].replace(",", "")))


def block(result: Result) -> list[str]:
    return [
        f"**Block**, {column}: {fastest(found).row.split()[-1]} threads, {listed(found)}."
        for column in columns(result)
        if (found := sizes(result, column, "block "))
    ]


def batch(result: Result) -> list[str]:
    return [
        f"**Batch**, {column}: a launch of {enough(found).row.split()[-1]} threads has {100 * CLOSE:.0f}% of the best"
        f" speed ({listed(found)})."
        for column in columns(result)
        if (found := sizes(result, column, "batch "))
    ]


def enough(figures: list[Figure]) -> Figure:
    best = fastest(figures).value
    return next(f for f in figures if f.value >= CLOSE * best)


def listed(figures: list[Figure]) -> str:
    return ", ".join(f"{f.row.split()[-1]}: {f.value:.3g}" for f in figures) + f" {figures[0].unit}"


def training_batch(result: Result) -> list[str]:
    found = [f for f in result.rows("samples") if f.row.startswith("2x32, ")]
    text = ", ".join(f"{f.row.removeprefix('2x32, ')}: {f.value:.3g}" for f in found)
    return [f"**Training batch**, 2x32, samples of a step and {found[0].unit}: {text}."] if found else []


def sharing(result: Result) -> list[str]:
    shuffled, ordered = ("float16 3x64, shuffled", "float16 3x64, sorted")
    pairs = [(f, result.find(f.row, ordered)) for f in result.rows(shuffled)]
    gains = [(f.row, other.value / f.value) for f, other in pairs if other]
    text = ", ".join(f"{row}: {gain:.2g}x" for row, gain in gains if len(row) < 6)
    return [f"**Many networks**: gain of `wn.sort_by_network` by threads that share one: {text}."] if text else []
