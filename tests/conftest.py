"""Fixtures: `device` is the CPU always, CUDA when present; `shared_data` and `started`, a browser, skip where there is
none."""

from pathlib import Path

import pytest
import warp as wp

wp.config.log_level = wp.LOG_WARNING
ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)], scope="session")
def device(request):
    if request.param != "cpu" and not wp.is_cuda_available():
        pytest.skip("no CUDA device on this machine")
    with wp.ScopedDevice(request.param):
        yield wp.get_device(request.param)


@pytest.fixture(scope="session")
def shared_data():
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"real materials are not at {folder}")
    return folder


@pytest.fixture(scope="module")
def started():
    """Chromium, for pages."""
    from warp_neural.samples.deployment import browser

    if lacking := browser.missing():
        pytest.skip(f"no {lacking}: pip install playwright, and .ci/tools says how to get chromium")
    with browser.browser() as found:
        yield found
