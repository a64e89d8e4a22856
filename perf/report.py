"""Gather results into one page: `python -m perf.report`, from perf/results/* to perf/RESULTS.md."""

from dataclasses import dataclass
from pathlib import Path

from perf.advice import advice
from perf.goal import Goal
from perf.goals import ELSEWHERE, GOALS, TESTED
from perf.profile import spoken
from perf.recorded import ORIGINS
from perf.results import FOLDER, Result, load_all
from warp_neural.cli import run
from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path

INTRO = """# Measurements

Made by `python -m perf --record`, gathered by `python -m perf.report`. Medians of the rounds, ± half of what 80 %
of them span. *Recorded*: measured by others or elsewhere, not in that run. LxN: L hidden layers of N neurons, N inputs,
16 outputs. Other libraries run as CUDA graphs, like Warp Neural, or, where they cannot, as the host's *(calls)*,
*(frozen calls)*.
`python -m perf.compare OLD NEW` shows what moved between two folders of results beyond its spread.
"""
MAIN = "inference"  # machines without it have but a few measurements, and only the goals of these
ORDER = (
    "inference", "divergence", "fusion", "layout", "precision", "training", "compile", "cpu", "mipmap", "samples",
    "texture_torch", "texture_reading", "profile",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Config:
    results: Path = FOLDER
    """folder with a folder of results for each machine"""
    out: Path | None = None
    """the page; default RESULTS.md beside the folder of results"""
    json: bool = False
    """print nothing but one JSON object with the metrics"""


def goals_table(results: dict[str, Result], cuda: bool) -> tuple[str, dict[str, int]]:
    """Markdown, a table for each thing that goals are about, and how many are met, missed, not measured."""
    lines, counts, reasons = [], {"met": 0, "missed": 0, "not measured": 0}, {}
    whole = not results or MAIN in results
    goals = [goal for goal in GOALS if goal.cuda == cuda and (whole or goal.measurement in results)]
    for about in dict.fromkeys(goal.about for goal in goals):
        lines += [f"#### {about}", "", "| goal | measured | asked for | |", "|---|---:|---:|---|"]
        for goal in (goal for goal in goals if goal.about == about):
            measured, asked, verdict = goal.judge(results)
            kind = next((kind for kind in ("met", "missed") if f"**{kind}**" in verdict), "not measured")
            counts[kind] += 1
            why = reason(goal, results)
            if kind == "missed" and why:
                verdict += f" [{reasons.setdefault(why, len(reasons) + 1)}]"
            lines.append(f"| {goal.text} | {measured} | {asked} | {verdict} |")
        lines.append("")
    lines += [f"[{number}] {why}  " for why, number in reasons.items()]
    return "\n".join(lines), counts


def listed(title: str, goals: dict[str, dict[str, str]]) -> list[str]:
    lines = [f"## {title}\n"]
    for about, found in goals.items():
        lines += [f"{about}:\n", *(f"- {goal}: {text}" for goal, text in found.items()), ""]
    return lines


def reason(goal: Goal, results: dict[str, Result]) -> str:
    """Why the goal may be missed, and the profile of its kernel where there is one."""
    profile = spoken(results["profile"], goal.kernel) if "profile" in results and goal.kernel else ""
    return " ".join(filter(None, (goal.why, profile)))


def section(result: Result, folder: str) -> str:
    return (
        f"### {result.measurement}\n\n{result.notes()}\n\n{result.table()}\n\n"
        f"![{result.measurement}](results/{folder}/{result.measurement}.png)\n"
    )


def machine_page(folder: Path) -> tuple[str, dict[str, int], bool]:
    """The page, how many goals are met, missed and not measured, and whether it is a GPU."""
    results = load_all(folder)
    if not results:
        raise InputError(f"{folder}: no results here; make them with python -m perf")
    main = results.get(MAIN) or next(iter(results.values()))
    cuda = "architecture" in main.machine
    goals, counts = goals_table(results, cuda)
    parts = [f"## {main.machine['device']}\n", "### What to choose\n", *(f"- {line}" for line in advice(results))]
    summary = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    parts += [f"\n### Goals: {summary}\n", goals, ""]
    known = [name for name in ORDER if name in results] + [name for name in results if name not in ORDER]
    return "\n".join([*parts, *(section(results[name], folder.name) for name in known)]), counts, cuda


def main(config: Config) -> dict:
    folders = sorted(path for path in config.results.glob("*") if path.is_dir())
    if not folders:
        raise InputError(f"{config.results}: no results; make them with python -m perf")
    pages, metrics, any_cuda = [], {}, False
    for folder in folders:
        page, counts, cuda = machine_page(folder)
        pages.append(page)
        any_cuda |= cuda
        metrics |= {f"{folder.name}_{kind.replace(' ', '_')}": count for kind, count in counts.items()}
    if not any_cuda:
        pages.append(f"## H200: not measured yet\n\n### Goals\n\n{goals_table({}, True)[0]}")
    tests = {about: {goal: f"`{names}`" for goal, names in goals.items()} for about, goals in TESTED.items()}
    rest = listed("Goals that tests hold", tests) + listed("Goals measured elsewhere", ELSEWHERE)
    rest += ["## Where recorded figures come from\n", *(f"- {origin.text()}" for origin in ORIGINS), ""]
    path = config.out or config.results.parent / "RESULTS.md"
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join([INTRO, *pages, *rest]), encoding="utf-8")
    return metrics | {"page": str(path)}


if __name__ == "__main__":
    run(main, Config)
