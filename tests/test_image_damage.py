"""Damaged image files end in an `InputError` of one line or are read; never a crash or another exception."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent


@pytest.mark.skipif(os.name != "posix", reason="limits memory as POSIX does")
def test_damaged_files():
    """In a process of its own: a crash is then a failure that names the file."""
    command = [sys.executable, "-W", "error", "image_damage.py", "0", "400"]
    paths = os.pathsep.join([str(TESTS.parent), os.environ.get("PYTHONPATH", "")])
    result = subprocess.run(
        command, cwd=TESTS, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 0, result.stdout[-80:] + result.stderr[-2000:]
    assert "400 damaged files" in result.stdout and not result.stderr
