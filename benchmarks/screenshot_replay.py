"""A picture of a replay page, as it is seen in Chromium.

python benchmarks/screenshot_replay.py [--time S] [--camera NAME] [--out FILE]

Runs the mission fig14, writes its page, opens it at a time, and saves what is seen. Needs
chromium and the Python package playwright.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from shape import Arguments

import omnitrack_sim as ot

SIZE = {"width": 1280, "height": 800}
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""Chromium as root and without graphics hardware."""


def main() -> None:
    """Run, write the page, photograph it."""
    parser = Arguments(__doc__)
    parser.add_argument("--time", type=float, default=5.1, help="s of the run")
    parser.add_argument("--camera", default="follow", choices=("orbit", "follow", "onboard"))
    parser.add_argument("--out", type=Path, default=Path("docs/figures/replay.png"))
    asked = parser.read()
    result = ot.run(ot.load_scenario("missions/fig14"))
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "replay.html"
        ot.render_replay(result, path=page)
        photograph(f"{page.as_uri()}#t={asked.time}&camera={asked.camera}", asked.out)
    print(f"saved {asked.out}")


def photograph(address: str, out: Path) -> None:
    """Save what is seen of a replay page at ``address``."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        chromium = shutil.which("chromium")
        browser = play.chromium.launch(executable_path=chromium, args=FLAGS)
        page = browser.new_page(viewport=SIZE)
        page.goto(address)
        page.wait_for_function("window.replay?.ready")
        page.wait_for_timeout(500)  # until the last size of the page is drawn
        page.screenshot(path=out)
        browser.close()


if __name__ == "__main__":
    main()
