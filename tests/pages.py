"""A browser for the tests of replay pages, and what they look at in it."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

CHROMIUM = shutil.which("chromium")
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
TOLERANCE = 1e-4
"""How far a body in the page may be from where MuJoCo has it, m."""


@contextmanager
def chromium() -> Iterator:
    """Chromium without a screen or graphics hardware."""
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield browser
        browser.close()


@contextmanager
def opened(browser, path: Path, width: int = 1000, height: int = 700, hash: str = "") -> Iterator:
    """A page without a network. Errors and requests beyond the file fail the test."""
    context = browser.new_context(viewport={"width": width, "height": height}, offline=True)
    page, faults = context.new_page(), []
    page.on("console", lambda message: faults.append(message.text))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: faults.append(request.url))
    page.goto(f"{path.as_uri()}{hash}")
    page.wait_for_function("window.replay?.ready", timeout=60_000)
    yield page
    context.close()
    own = (path.as_uri(), "blob:", "data:")
    assert [fault for fault in faults if not fault.startswith(own)] == []


def picture(page) -> np.ndarray:
    """The drawn view (h, w, 3) as it is seen, without what lies over it."""
    page.wait_for_timeout(150)
    image = Image.open(io.BytesIO(page.locator("#stage").screenshot()))
    return np.asarray(image.convert("RGB"), float)
