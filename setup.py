"""Installed is `warp_neural` alone: `kernels` and `samples` of the checkout become parts of it."""

from setuptools import find_packages, setup

inside = find_packages(include=["kernels*", "samples*"])
setup(
    packages=find_packages(include=["warp_neural*"]) + [f"warp_neural.{name}" for name in inside],
    package_dir={"warp_neural.kernels": "kernels", "warp_neural.samples": "samples"},
)
