"""What commands print: metrics, the files that they made, progress."""

import codecs
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tqdm import tqdm

PLAIN = {"∂": "d", "·": "*", "Σ": "sum", "∇": "grad ", "±": "+-", "°": " degrees"}  # where a terminal lacks a sign


def _plain(error: UnicodeEncodeError) -> tuple[str, int]:
    return "".join(PLAIN.get(sign, "?") for sign in error.object[error.start : error.end]), error.end


codecs.register_error("plain", _plain)


def printable() -> None:
    """From here on stdout and stderr take every text, whatever their encoding."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="plain")


def lines_of(metrics: dict[str, Any]) -> list[str]:
    """One a metric; of a dict one an entry, of a list of dicts a table."""
    lines = []
    for key, value in metrics.items():
        if isinstance(value, dict):
            lines += lines_of({f"{key} {name}": inner for name, inner in value.items()})
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            lines += table(value)
        else:
            lines.append(f"{key:24} {text_of(value)}")
    return lines


def text_of(value: Any) -> str:
    if isinstance(value, list | tuple):
        return " ".join(map(text_of, value)) or "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def table(rows: list[dict[str, Any]]) -> list[str]:
    cells = [list(rows[0]), *([text_of(value) for value in row.values()] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.rjust, row, widths)) for row in cells]


def lines_of_files(paths: Iterable[Path]) -> list[str]:
    """`made in out/mipmap: maps.png, metrics.json`, a line for each folder."""
    folders: dict[Path, list[str]] = {}
    for path in paths:
        folders.setdefault(path.parent, []).append(path.name)
    return [f"made in {folder}: {', '.join(names)}" for folder, names in folders.items()]


def progress(iterable: Iterable, config: Any, **options: Any) -> tqdm:
    """A progress bar on stderr; silent with `--json` or without a terminal."""
    silent = True if config.json or sys.stderr is None else None
    return tqdm(iterable, disable=silent, file=sys.stderr, **options)
