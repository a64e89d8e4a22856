"""Imports point one way: samples -> warp_neural -> kernels, and kernels imports only Warp and the standard library."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
OURS = {"kernels", "warp_neural", "samples", "perf", "tests"}
ALLOWED = {"kernels": {"kernels"}, "warp_neural": {"kernels", "warp_neural"}, "samples": {"samples", "warp_neural"}}


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_point_one_way(package):
    files = list((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        assert imported(path) & OURS <= ALLOWED[package], path
        if package == "kernels":
            assert imported(path) - OURS <= {"warp"} | set(sys.stdlib_module_names), path
