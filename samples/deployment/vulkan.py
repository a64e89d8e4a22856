"""Exported folders for Vulkan: their program, built and run on whatever driver there is."""

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np

FILES = "*.spv", "weights.bin", "matrices.bin"
NO_DRIVER = 77


@cache
def missing() -> str | None:
    """What it takes to build a folder's program, and is not there."""
    if not shutil.which("g++"):
        return "g++"
    command = ["g++", "-fsyntax-only", "-x", "c++", "-include", "vulkan/vulkan.h", "/dev/null"]
    return "Vulkan headers" if subprocess.run(command, capture_output=True).returncode else None


def built(folder: Path, program: Path, *options: str) -> Path:
    command = ["g++", "-std=c++17", "-O2", *options, str(folder / "main.cpp"), "-ldl", "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{folder}: {done.stderr}")
    return program


def evaluate(folder: Path, inputs: np.ndarray, expected: np.ndarray) -> tuple[str, np.ndarray | None, float]:
    """The device or what is missing, results, and the seconds of a run on the device; rows lie in a folder beside."""
    if lacking := missing():
        return f"not run: no {lacking}", None, 0.0
    build, rows = folder / "build", folder / "rows"
    for path in (build, rows):
        path.mkdir(exist_ok=True)
    for file in (file for pattern in FILES for file in folder.glob(pattern)):
        shutil.copy(file, rows)
    inputs.tofile(rows / "inputs.bin")
    expected.tofile(rows / "outputs.bin")
    program = built(folder, build.resolve() / "program")
    command = [str(program), str(rows.resolve()), "--rows", "1", "--results", "results.bin"]
    done = subprocess.run(command, cwd=build, capture_output=True, text=True)
    if done.returncode == NO_DRIVER:
        return "not run: no Vulkan driver", None, 0.0
    if done.returncode > 1:
        raise RuntimeError(f"{folder}: {done.stderr}")
    on, how = re.search(r"^device (\d+), ([\w ]+):", done.stdout, re.M).groups()
    (name,) = re.findall(rf"^device {on}: (.*), Vulkan", done.stdout, re.M)
    milliseconds = re.search(r"([\d.]+) ms, the median", done.stdout)
    results = np.fromfile(build / "results.bin", np.float32).reshape(expected.shape)
    return f"{name}, {how}", results, 1e-3 * float(milliseconds[1]) if milliseconds else 0.0
