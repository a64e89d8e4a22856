"""What a measurement leaves: figures with their spread, as JSON and as one Markdown table."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path

RECORDED = " *(recorded)*"
FOLDER = Path(__file__).resolve().parent / "results"


@dataclass(frozen=True)
class Figure:
    """One cell of a table: the median of the rounds and where 80 % of them lie. `row` and `column` name it.

    recorded: measured by others or elsewhere, not in this run; it has no spread.
    """

    row: str
    column: str
    value: float
    low: float
    high: float
    unit: str
    note: str = ""
    recorded: bool = False

    def text(self) -> str:
        whole = abs(self.value) >= 1e4 or float(self.value).is_integer()
        number = f"{self.value:,.0f}" if whole else f"{self.value:.3g}"
        if self.high > self.low and self.value:
            number += f" ±{50 * (self.high - self.low) / abs(self.value):.2g}%"
        return f"{number} {self.note}".strip()


@dataclass
class Result:
    """All figures of one measurement on one machine."""

    measurement: str
    machine: dict[str, str]
    settings: dict[str, str]
    figures: list[Figure] = field(default_factory=list)

    def find(self, row: str, column: str) -> Figure | None:
        return next((f for f in self.figures if (f.row, f.column) == (row, column)), None)

    def rows(self, column: str) -> list[Figure]:
        return [f for f in self.figures if f.column == column]

    def table(self) -> str:
        """Markdown. The usual unit is in the corner; others stand by their rows, or by columns where rows mix units."""
        units = [f.unit for f in self.figures]
        usual = max(dict.fromkeys(units), key=units.count, default="")
        headers, by_column = {}, set()
        for name in dict.fromkeys(f.column for f in self.figures):
            column = self.rows(name)
            mixed = len({f.unit for f in column}) == 1 and any(len(self.units(f.row)) > 1 for f in column)
            if mixed:
                by_column.add(name)
            header = f"{name}, {column[0].unit}" if mixed and column[0].unit not in ("", usual) else name
            headers[name] = header + (RECORDED if all(f.recorded for f in column) else "")
        lines = [f"| {usual} | {' | '.join(headers.values())} |", "|---" + "|---:" * len(headers) + "|"]
        rows = {}
        for f in self.figures:
            unit = "" if f.unit == usual or f.column in by_column else f.unit
            label = ", ".join(filter(None, (f.row, unit)))
            label += RECORDED if f.recorded and RECORDED not in headers[f.column] else ""
            rows.setdefault(label, {})[f.column] = f.text()
        lines += [
            f"| {label} | {' | '.join(cells.get(name, '') for name in headers)} |" for label, cells in rows.items()
        ]
        return "\n".join(lines)

    def units(self, row: str) -> set[str]:
        return {f.unit for f in self.figures if f.row == row}

    def notes(self) -> str:
        facts = self.machine | self.settings
        return "; ".join(f"{key} {value}" if key != "device" else value for key, value in facts.items())

    def metrics(self) -> dict[str, float]:
        """Plain numbers for `--json`; what is not finite is left out."""
        return {f"{f.row} / {f.column}": f.value for f in self.figures if np.isfinite(f.value)}

    def save(self, folder: Path) -> Path:
        path = folder / f"{self.measurement}.json"
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(asdict(self), indent=1) + "\n")
        return path

    @classmethod
    def load(cls, path: Path) -> "Result":
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            figures = [Figure(**figure) for figure in data.pop("figures")]
            return cls(**data, figures=figures)
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise InputError(f"{path}: not a result of perf ({error}); measure again") from error


def load_all(folder: Path) -> dict[str, Result]:
    """The results in a folder by measurement."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of results; make it with python -m perf")
    return {path.stem: Result.load(path) for path in sorted(folder.glob("*.json"))}
