"""Draws the stills and the map that the documents show:
python benchmarks/stills.py [--out FOLDER]

It runs four shipped scenarios and takes a minute. The other pictures are drawn by the commands
that their pages name.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image

import omnitrack_sim as ot

FILM = 960, 540


def main() -> None:
    """Write tee.png, and figures/film_*.png, fig14_onboard.png, explore_onboard.png,
    mission_frame.png and mission_map.png, into a folder."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/stills"), help="such as docs")
    folder = parser.parse_args().out
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    turn = ot.run(ot.load_scenario("tee_turn"))
    still(turn, 3.1, "side", (1280, 720), folder / "tee.png")
    still(turn, 3.6, "side", FILM, figures / "film_side.png")
    ot.render_strip(turn, path=figures / "film_strip.png", width=480, height=360)
    journey = ot.run(ot.load_scenario("missions/fig14"))
    still(journey, 13.0, "follow", FILM, figures / "film_follow.png")
    still(journey, 2.0, "onboard", FILM, figures / "film_onboard.png")
    seeing = ot.run(ot.load_scenario("missions/fig14_onboard"))
    still(seeing, 18.0, "follow", FILM, figures / "fig14_onboard.png")
    exploring = ot.run(ot.load_scenario("missions/explore_onboard"))
    still(exploring, 26.0, "follow", FILM, figures / "explore_onboard.png")
    mission = ot.run(ot.load_scenario("missions/dead_end"))
    still(mission, 16.0, "follow", (800, 450), figures / "mission_frame.png")
    ot.plot_mission(mission, path=figures / "mission_map.png")


def still(result: ot.Result, time: float, camera: str, size: tuple[int, int], path: Path) -> None:
    """Save the frame of a film at a time, s."""
    Image.fromarray(
        ot.render_frame(result, time=time, camera=camera, width=size[0], height=size[1])
    ).save(path, optimize=True)
    print(f"saved {path}")


if __name__ == "__main__":
    main()
