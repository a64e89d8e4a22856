"""`samples.deployment` at toy size."""

import shutil

import pytest
from skimage import data

from warp_neural.errors import InputError
from warp_neural.export import TARGETS, spirv
from warp_neural.imaging.image import load_image, save_image
from warp_neural.samples.deployment import __main__ as deployment
from warp_neural.samples.deployment import browser, vulkan


def test_every_target(tmp_path, device):
    """What can run gives Python's picture; what cannot says why."""
    save_image(tmp_path / "small.png", data.astronaut()[:64:2, 96:160:2] / 255, color_space="linear")
    config = deployment.Config(
        out=tmp_path / "out", image=tmp_path / "small.png", steps=20, device=str(device), json=True
    )
    metrics = deployment.main(config)
    precision = "float16" if device.is_cuda else "float32"
    assert (tmp_path / "out" / "cpp" / "picture.hpp").is_file() and metrics["how_msl"].startswith("not run")
    for target in TARGETS:
        ran = not metrics[f"how_{target}"].startswith("not run")
        exported = target != "vulkan" or not spirv.missing(precision)
        assert ran == (f"difference_{target}" in metrics) and (metrics[f"bytes_{target}"] > 1000) == exported
        if ran:
            limit = {"cpp": 0, "html": 1e-2}.get(target, 1e-2 if device.is_cuda else 1e-5)  # a page has 8 bits
            assert metrics[f"difference_{target}"] <= limit
    if lacking := spirv.missing(precision) or vulkan.missing():
        assert metrics["how_vulkan"] == f"not run: no {lacking}"
    assert (metrics["how_cpp"] == "g++") == bool(shutil.which("g++"))
    assert metrics["how_html"].startswith("Chromium") == (browser.missing() is None)
    assert load_image(tmp_path / "out" / "deployment.png").std() > 0.05


def test_unknown_targets(tmp_path):
    with pytest.raises(InputError, match=r"--targets fortran: give some of cpp"):
        deployment.main(deployment.Config(out=tmp_path, targets="cpp,fortran", device="cpu"))
