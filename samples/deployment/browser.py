"""Exported pages in Chromium without a window, driven by playwright; $CHROMIUM, or one that is installed."""

import base64
import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image

FLAGS = "--no-sandbox", "--enable-unsafe-swiftshader"  # WebGL2 on the CPU
OWN = "GPU stall due to ReadPixels"
SETTLED = "#picture[aria-busy=false]"


@cache
def chromium() -> str | None:
    names = os.environ.get("CHROMIUM"), "chromium", "chromium-browser", "google-chrome"
    return next(filter(None, (shutil.which(name) for name in names if name)), None)


def missing() -> str | None:
    """What it takes to show pages and is not there."""
    if not find_spec("playwright"):
        return "playwright"
    return None if chromium() else "chromium"


@contextmanager
def browser() -> Iterator:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=chromium(), args=FLAGS)
        try:
            yield started
        finally:
            started.close()


def opened(started, path: Path, said: list[str] | None = None, script: str = "", **options):
    """The page of a file, drawn. said: gets what it asks for and what it says; script: runs before the page's.
    options: of playwright's new_page.

    Without a GPU the browser itself reads what a page has drawn, and its driver calls that slow, in the page's name."""
    page = started.new_page(viewport={"width": 280, "height": 640}, **options)
    said = [] if said is None else said
    page.on("request", lambda request: said.append(request.url))
    page.on("console", lambda message: OWN in message.text or said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.add_init_script(script)
    page.goto(path.resolve().as_uri())
    page.wait_for_selector(SETTLED)
    return page


def pixels(page) -> tuple[np.ndarray, np.ndarray]:
    """What is shown, 8 bits [height, width, 3], and where: (u, v) [height, width, 2] of the pixels' centres."""
    page.wait_for_selector(SETTLED)
    canvas = page.locator("#picture")
    data = canvas.evaluate("canvas => canvas.toDataURL()").partition(",")[2]
    codes = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))
    u, v, du, dv = map(float, canvas.get_attribute("data-view").split())
    height, width = codes.shape[:2]
    across, down = u + (np.arange(width) + 0.5) * du, v + (height - np.arange(height) - 0.5) * dv
    return codes, np.stack(np.meshgrid(across, down), axis=-1)


def milliseconds(page) -> tuple[float, float]:
    """From opening to the first picture, and of a frame."""
    return tuple(float(page.locator(f"#{name}").get_attribute("data-milliseconds")) for name in ("first", "frame"))
