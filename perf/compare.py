"""What moved between two folders of results: `python -m perf.compare OLD NEW`.

Figures whose spreads (10 to 90 % of the rounds) do not overlap, largest change first; recorded ones are left out. A
figure without a spread has moved when it differs by more than 2 %.
"""

from dataclasses import dataclass
from pathlib import Path

import tyro

from perf.results import Figure, load_all
from warp_neural.cli import run

LEAST = 0.02


@dataclass(frozen=True)
class Config:
    old: tyro.conf.Positional[Path]
    """folder of results, such as perf/results/nvidia-h200"""
    new: tyro.conf.Positional[Path]
    """the same, later"""
    json: bool = False
    """print nothing but one JSON object with the changes"""


def moved(old: Figure, new: Figure) -> bool:
    if old.high == old.low or new.high == new.low:
        return abs(new.value - old.value) > LEAST * abs(old.value)
    return new.low > old.high or new.high < old.low


def figures(folder: Path) -> dict[tuple[str, str, str], Figure]:
    return {
        (name, figure.row, figure.column): figure
        for name, result in load_all(folder).items()
        for figure in result.figures
        if not figure.recorded
    }


def main(config: Config) -> dict:
    old, new = figures(config.old), figures(config.new)
    both = [key for key in old if key in new]
    changes = {key: new[key].value / old[key].value - 1 for key in both if old[key].value and moved(old[key], new[key])}
    changes = dict(sorted(changes.items(), key=lambda item: -abs(item[1])))
    print("| measurement | row | column | old | new | change |\n|---|---|---|---:|---:|---:|")
    for key, change in changes.items():
        unit = f" {new[key].unit}"
        print(f"| {' | '.join(key)} | {old[key].text()}{unit} | {new[key].text()}{unit} | {100 * change:+.1f}% |")
    alone = len(old) - len(both), len(new) - len(both)
    print(f"\n{len(changes)} of {len(both)} moved; only in old: {alone[0]}, only in new: {alone[1]}")
    return {" / ".join(key): change for key, change in changes.items()} if config.json else {}


if __name__ == "__main__":
    run(main, Config)
