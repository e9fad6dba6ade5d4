"""The window of `omnitrack drive` in the middle of a tee turn, as docs/how-to/viewer.md shows it.

It is driven on a virtual screen (Xvfb) by the keys that a driver would press.

    python benchmarks/viewer_picture.py docs/viewer.png
"""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import ImageGrab
from shape import Arguments

import omnitrack_sim as ot

if TYPE_CHECKING:
    from omnitrack_sim.show.viewer.window import Window

SCREEN = (1500, 900)
"""Pixels; MuJoCo's window takes two thirds of them each way."""
SETTINGS = {"start.theta5_deg": -20.0, "start.distance": 0.24}


def main() -> None:
    """Drive to the tee, and take the picture there."""
    parser = Arguments(__doc__)
    parser.add_argument("picture", type=Path)
    picture = parser.read().picture
    read, write = os.pipe()
    size = "x".join(map(str, (*SCREEN, 24)))
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", size], pass_fds=[write]
    )
    try:
        with os.fdopen(read) as answer:
            display = os.environ["DISPLAY"] = f":{answer.readline().strip()}"
        from omnitrack_sim.show.viewer.window import Window

        scenario = ot.override(ot.load_scenario("tee_turn"), SETTINGS)
        with Window(scenario) as window:
            _drive(scenario, window)
            area = (0, 0, *(2 * side // 3 for side in SCREEN))
            ImageGrab.grab(area, xdisplay=display).save(picture, optimize=True)
    finally:
        server.terminate()
        server.wait()


def _drive(scenario: ot.Scenario, window: Window) -> None:
    from omnitrack_sim.show.viewer.driver import Driver
    from omnitrack_sim.show.viewer.keys import Do

    driver = Driver(scenario, window)
    stage = driver.run

    def show(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            window.show(stage.qpos(), driver.panels())
            time.sleep(0.05)

    def until(time_s: float) -> None:
        while stage.time < time_s:
            stage.step()

    show(1.0)
    for do, count in ((Do.ROLL_BACK, 4), (Do.FORWARD, 4), (Do.RIGHT, 6)):
        for _ in range(count):
            driver.act(do)
        until(stage.time + (1.0 if do is Do.ROLL_BACK else 0.0))
    until(2.45)
    show(2.0)


if __name__ == "__main__":
    main()
