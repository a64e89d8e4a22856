"""Imports point one way: samples -> warp_neural -> kernels, and inside each from room to room in the order below."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# each room may import those of earlier lines, and itself
ROOMS = """
kernels.native kernels.errors kernels.kept
kernels.nn
kernels.autodiff kernels.coopvec kernels.shading
kernels.training.progress kernels.training.schedule
kernels.training.text
kernels.training.taped
kernels.training.cpu kernels.training.mma kernels.training.hopper64
kernels.training.hopper128
kernels.training
kernels.texture
kernels.materials
kernels.render
errors
config io
coopvec
nn
train autodiff imaging
materials
texture
render
export
torch
viewer
batch
cli
samples
"""
LEVEL = {f"warp_neural.{name}": level for level, line in enumerate(ROOMS.split("\n")) for name in line.split()}
FILES = [path for folder in ("kernels", "warp_neural", "samples") for path in sorted((ROOT / folder).rglob("*.py"))]


def module_of(path: Path) -> str:
    """Its name when installed."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[:-1] if parts[-1] == "__init__" else parts
    return ".".join(parts if parts[0] == "warp_neural" else ("warp_neural", *parts))


def room_of(module: str) -> str | None:
    return next((room for room in LEVEL if f"{module}.".startswith(f"{room}.")), None)


def imported(path: Path) -> set[str]:
    """Full names, those of `from package import name` with the name."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path):
    module, names = module_of(path), imported(path)
    assert not {name.split(".")[0] for name in names} & {"kernels", "samples", "perf", "tests"}, "by their full names"
    if module in ("warp_neural", "warp_neural.kernels"):  # the package itself, and what makes its names in a checkout
        return
    room = room_of(module)
    assert room, f"{module} has no room; add it to ROOMS"
    for name in names:
        other = room_of(name)
        if other and other != room:
            assert LEVEL[other] < LEVEL[room], f"{module} imports {name}"
    if room.startswith("warp_neural.kernels"):
        assert {name.split(".")[0] for name in names} <= {"warp", "warp_neural"} | set(sys.stdlib_module_names)


def test_short_names_are_for_the_outside():
    """`wn.MLP` and the like come from the package, which imports every room: inside, from the rooms themselves."""
    for path in FILES:
        if path.relative_to(ROOT).parts[0] != "samples" and module_of(path) != "warp_neural":
            assert not {name for name in imported(path) if name == "warp_neural"}, path
