"""Charts of results, without a window."""

from collections.abc import Iterable

from perf.results import Figure, Result


def axes(title: str, unit: str, width: float = 9.0, height: float = 4.5):
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(width, height), layout="constrained")
    ax = canvas.subplots()
    ax.set_title(title)
    ax.set_ylabel(unit)
    ax.grid(axis="y", alpha=0.3)
    return canvas, ax


def bars(result: Result, title: str, unit: str):
    """Rows of one unit as groups, columns as bars, spreads as whiskers; what was recorded is hatched."""
    figures = [f for f in result.figures if f.unit == unit]
    rows = list(dict.fromkeys(f.row for f in figures))
    columns = list(dict.fromkeys(f.column for f in figures))
    canvas, ax = axes(f"{title}\n{result.machine['device']}", unit, width=max(7.0, 1.1 * len(rows)))
    step = 0.8 / len(columns)
    for j, column in enumerate(columns):
        shown = [f for f in figures if f.column == column]
        at = [rows.index(f.row) + (j - (len(columns) - 1) / 2) * step for f in shown]
        bottom = [[f.value - f.low for f in shown], [f.high - f.value for f in shown]]
        hatches = ["//" if f.recorded else "" for f in shown]
        values = [f.value for f in shown]
        ax.bar(at, values, step, yerr=bottom, hatch=hatches, label=column, color=f"C{j}", edgecolor="white")
    ax.set_xticks(range(len(rows)), rows, rotation=25, ha="right", fontsize=8)
    values = [f.value for f in figures if f.value > 0]
    if max(values) > 30 * min(values):
        ax.set_yscale("log")
    if len(columns) > 1:
        title = "hatched: recorded" if any(f.recorded for f in figures) else None
        ax.legend(fontsize=8, title=title, loc="upper left", bbox_to_anchor=(1, 1))
    return canvas


def line(ax, figures: Iterable[Figure], label: str, **style) -> None:
    """Figures over their rows, which are numbers; a band shows the spread."""
    figures = [f for f in figures if f.value > 0]
    x = [float(f.row.replace(",", "")) for f in figures]
    (drawn,) = ax.plot(x, [f.value for f in figures], label=label, **style)
    ax.fill_between(x, [f.low for f in figures], [f.high for f in figures], color=drawn.get_color(), alpha=0.2)


def steps(result: Result):
    """Of training: the step of each row as a bar, those of other libraries, rows `ROW, LIBRARY`, as points in it."""
    from matplotlib.figure import Figure as Canvas

    figures = [f for f in result.rows("step") if f.unit == "ms"]
    rows = [f.row for f in figures if not any(f.row.startswith(f"{other.row}, ") for other in figures)]
    canvas = Canvas(figsize=(9, 1.5 + 0.22 * len(rows)), layout="constrained")
    ax = canvas.subplots()
    ours = [f for f in figures if f.row in rows]
    ax.barh([f.row for f in ours], [f.value for f in ours], color="C0", alpha=0.7, label="Warp Neural")
    others = {}
    for f in figures:
        for row in rows:
            if f.row.startswith(f"{row}, "):
                name = f.row.removeprefix(f"{row}, ") + " (recorded)" * f.recorded
                others.setdefault(name, []).append((f.value, row))
    for i, (name, points) in enumerate(others.items()):
        ax.plot(*zip(*points, strict=True), "oDs^vP*X"[i % 8], color=f"C{i + 1}", label=name)
    ax.set(title=f"One training step\n{result.machine['device']}", xlabel="ms", xscale="log")
    ax.invert_yaxis()
    ax.grid(axis="x", which="both", alpha=0.3)
    canvas.legend(loc="outside lower center", ncols=4, fontsize=8)
    return canvas


def shares(result: Result):
    """Of a profile: the instructions of each kernel by kind, and what the counters say in percent, where they are."""
    from matplotlib.figure import Figure as Canvas

    rows = list(dict.fromkeys(f.row for f in result.figures))
    canvas = Canvas(figsize=(15, 1.5 + 0.2 * len(rows)), layout="constrained")
    left, right = canvas.subplots(1, 2, sharey=True)
    names = [name for name in dict.fromkeys(f.column for f in result.figures) if name.endswith(" instructions")]
    at = dict.fromkeys(rows, 0.0)
    for i, name in enumerate(names):
        values = [f.value if (f := result.find(row, name)) else 0.0 for row in rows]
        left.barh(rows, values, left=list(at.values()), color=f"C{i}", label=name.removesuffix(" instructions"))
        at = {row: at[row] + value for row, value in zip(rows, values, strict=True)}
    for i, name in enumerate(dict.fromkeys(f.column for f in result.figures if f.unit == "%")):
        figures = result.rows(name)
        right.plot([f.value for f in figures], [f.row for f in figures], "o", color=f"C{i}", label=name)
    left.set(title=f"Instructions of the program\n{result.machine['device']}", xlabel="instructions")
    right.set(title="Percent of the peak", xlabel="%", xlim=(0, 100))
    left.invert_yaxis()
    for ax in (left, right):
        ax.grid(axis="both", alpha=0.3)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize=8)
    return canvas
