"""Exported C++ programs, built and run on the rows of a picture."""

import re
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp

NAME = "picture"
FLAGS, EXACT = ("-std=c++17", "-O3"), ("-march=native", "-ffp-contract=off")


@dataclass(frozen=True)
class Run:
    """Results [..., 3] where it ran, and Python's; how, or what is missing."""

    how: str
    results: np.ndarray | None = None
    expected: np.ndarray | None = None
    seconds: float = 0.0

    @property
    def difference(self) -> float:
        return float(np.abs(self.results - self.expected).max())


def run_cpp(folder: Path, inputs: np.ndarray, expected: np.ndarray) -> Run:
    """The program of the folder, on rows of its own in a folder beside."""
    if not shutil.which("g++"):
        return Run("not run: no g++")
    program, rows = folder / "build" / NAME, folder / "rows"
    for path in (program.parent, rows):
        path.mkdir(exist_ok=True)
    subprocess.run(["g++", *FLAGS, *EXACT, str(folder / "main.cpp"), "-o", str(program)], check=True)
    inputs.tofile(rows / "inputs.bin")
    expected.tofile(rows / "outputs.bin")
    began = time.perf_counter()
    subprocess.run([str(program), str(rows), str(rows / "results.bin")], stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - began
    return Run("g++", np.fromfile(rows / "results.bin", np.float32).reshape(expected.shape), expected, seconds)


def run_cuda(folder: Path, inputs: np.ndarray, expected: np.ndarray) -> Run:
    """The program of the folder, of a copy with rows of its own; how long more rows take it, it says itself."""
    if not shutil.which("g++"):
        return Run("not run: no g++")
    copy = folder / "build"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("build"), dirs_exist_ok=True)
    program = copy / NAME
    subprocess.run(["g++", *FLAGS, str(copy / "main.cpp"), "-o", str(program), "-ldl"], check=True)
    inputs.tofile(copy / "inputs.bin")
    expected.tofile(copy / "outputs.bin")
    command = [str(program), str(copy), "--results", str(copy / "results.bin")]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode == 77:
        return Run(f"not run: {done.stderr.strip()}")
    rows, milliseconds = re.search(r"(\d+) rows: ([\d.]+) ms", done.stdout).groups()
    results = np.fromfile(copy / "results.bin", np.float32).reshape(expected.shape)
    return Run(done.stdout.split(",")[0], results, expected, 1e-3 * float(milliseconds) * len(inputs) / int(rows))


RUN = {"cpp": run_cpp, "cuda": run_cuda}


def archs() -> list[int]:
    """That of the device is enough here; without one, Hopper's."""
    return [wp.get_cuda_device(0).arch if wp.is_cuda_available() else 90]
