"""One goal of the project for speed or quality, and whether a machine's results meet it."""

from dataclasses import dataclass

from perf.results import Result


@dataclass(frozen=True)
class Goal:
    """The figure that decides it, by measurement, row and column: `limit` in `unit`, which is the figure's; `most`: it
    must not exceed it. `cuda`: on an H200, else on one core of a CPU. `why`: what holds the figure back where it misses
    the goal, and what was tried; `kernel`: its row in `perf.profile`.

    of: another figure of the same measurement, row and column, whose multiple the limit is.
    """

    about: str
    text: str
    measurement: str
    row: str
    column: str
    limit: float
    most: bool = False
    cuda: bool = True
    of: tuple[str, str] | None = None
    unit: str = ""
    why: str = ""
    kernel: str = ""

    def judge(self, results: dict[str, Result]) -> tuple[str, str, str]:
        """What was measured, the goal, and whether it is met with the distance; in words."""
        result = results.get(self.measurement)
        figure = result and result.find(self.row, self.column)
        base = 1.0
        if self.of:
            other = result and result.find(*self.of)
            figure, base = (figure, other.value) if other else (None, 1.0)
        sign = "at most" if self.most else "at least"
        unit = f" {self.unit}" if self.unit and not self.of else ""
        goal = f"{sign} {self.limit:.3g}" + (f" of {self.of[0]}" if self.of else unit)
        if figure is None:
            return "not measured here", goal, ""
        value = figure.value / base
        met = value <= self.limit if self.most else value >= self.limit
        distance = f"{100 * (value / self.limit - 1):+.0f}%"
        return f"{value:.3g}{unit}", goal, f"**{'met' if met else 'missed'}** ({distance})"
