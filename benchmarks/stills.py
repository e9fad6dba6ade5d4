"""Draws the stills and the map that the documents show:
python benchmarks/stills.py [--out FOLDER]

It runs two shipped scenarios and takes a minute. The other pictures are drawn by the commands that
their pages name.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image

import omnitrack_sim as ot

FAST = {"physics.collider": "exact"}


def main() -> None:
    """Write tee.png, and figures/mission_frame.png and mission_map.png, into a folder."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/stills"), help="such as docs")
    folder = parser.parse_args().out
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    turn = ot.run(ot.load_scenario("tee_turn", FAST))
    still(turn, 3.1, "side", (1280, 720), folder / "tee.png")
    mission = ot.run(ot.load_scenario("missions/dead_end", FAST))
    still(mission, 16.0, "follow", (800, 450), folder / "figures" / "mission_frame.png")
    ot.plot_mission(mission, folder / "figures" / "mission_map.png")


def still(result: ot.Result, time: float, camera: str, size: tuple[int, int], path: Path) -> None:
    """Save the frame of a film at a time, s."""
    Image.fromarray(ot.render_frame(result, time, camera, *size)).save(path)
    print(f"saved {path}")


if __name__ == "__main__":
    main()
