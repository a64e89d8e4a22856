"""Cooperative vectors: matrix products of the vectors that single threads hold, on tensor cores where there are any."""

from pathlib import Path

NATIVE = Path(__file__).with_name("native")  # C++ and CUDA files
