"""Native files of training and encodings say in their first comment which constants they are pasted behind."""

import re
from pathlib import Path

import pytest

import warp_neural.kernels

KERNELS = Path(warp_neural.kernels.__file__).parent
FILES = [path for room in ("training", "nn") for path in sorted((KERNELS / room).rglob("native/*"))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.parent.name}/{path.name}")
def test_first_comment(path):
    comment, _, text = path.read_text().partition("\n\n")
    assert all(line.startswith("//") for line in comment.split("\n"))
    text = re.sub(r'//.*|"[^"]*"|__\w+', "", text)
    constants = set(re.findall(r"\b[A-Z][A-Z_]*\b", text)) - set(re.findall(r"constexpr \w+ (\w+)", text))
    assert constants <= set(re.findall(r"\w+", comment))
    assert max(map(len, path.read_text().split("\n"))) <= 120
