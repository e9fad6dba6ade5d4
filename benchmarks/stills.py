"""Draws the pictures of shipped scenarios that README and docs show.

python benchmarks/stills.py SERIES ... --out FOLDER

Series: turn (the tee turn: stills, strip, plots), missions (stills and a map), onboard (a robot by
its cameras, and one that explores), bench (the tests of an afternoon, side by side).
"""

from __future__ import annotations

from pathlib import Path

from PIL import Image
from shape import Arguments

import omnitrack_sim as ot

FILM = 960, 540
TILE = 320, 360


def turn(folder: Path) -> None:
    """tee.png, film_side.png, film_strip.png, summary.png, channel.png, compare_runs.png."""
    run = ot.run(ot.load_scenario("tee_turn"))
    still(run, 3.1, "side", (1280, 720), folder / "tee.png")
    still(run, 3.6, "side", FILM, folder / "film_side.png")
    ot.render_strip(run, path=folder / "film_strip.png", width=480, height=360)
    ot.plot_summary(run, path=folder / "summary.png")
    ot.plot_channel(run, channel="belt_speed", path=folder / "channel.png", module=1)
    slippery = ot.run(ot.load_scenario("tee_turn", {"world.friction": 0.45}))
    ot.plot_compare(run, slippery, path=folder / "compare_runs.png")


def missions(folder: Path) -> None:
    """film_follow.png, film_onboard.png, mission_frame.png, mission_map.png."""
    journey = ot.run(ot.load_scenario("missions/fig14"))
    still(journey, 13.0, "follow", FILM, folder / "film_follow.png")
    still(journey, 2.0, "onboard", FILM, folder / "film_onboard.png")
    mission = ot.run(ot.load_scenario("missions/dead_end"))
    still(mission, 16.0, "follow", (800, 450), folder / "mission_frame.png")
    ot.plot_mission(mission, path=folder / "mission_map.png")


def onboard(folder: Path) -> None:
    """fig14_onboard.png, explore_onboard.png."""
    seeing = ot.run(ot.load_scenario("missions/fig14_onboard"))
    still(seeing, 18.0, "follow", FILM, folder / "fig14_onboard.png")
    exploring = ot.run(ot.load_scenario("missions/explore_onboard"))
    still(exploring, 26.0, "follow", FILM, folder / "explore_onboard.png")


def bench(folder: Path) -> None:
    """bench.png: slide, pull, climb, stall and elbow."""
    times = {"slide": 2.2, "pull": 3.0, "climb": 1.4, "stall": 3.0, "elbow": 4.5}
    picture = Image.new("RGB", (TILE[0] * len(times), TILE[1]))
    for k, (test, time) in enumerate(times.items()):
        run = ot.run(ot.load_scenario(f"calibration/{test}"))
        frame = ot.render_frame(run, time=time, camera="side", width=TILE[0], height=TILE[1])
        picture.paste(Image.fromarray(frame), (TILE[0] * k, 0))
    picture.save(folder / "bench.png", optimize=True)


SERIES = {draw.__name__: draw for draw in (turn, missions, onboard, bench)}


def still(result: ot.Result, time: float, camera: str, size: tuple[int, int], path: Path) -> None:
    """Save the frame of a film at a time, s."""
    Image.fromarray(
        ot.render_frame(result, time=time, camera=camera, width=size[0], height=size[1])
    ).save(path, optimize=True)


def main() -> None:
    """Draw the series that are asked for."""
    parser = Arguments(__doc__)
    parser.add_argument("series", nargs="+", choices=tuple(SERIES), metavar="SERIES")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.read()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.series:
        SERIES[name](given.out)


if __name__ == "__main__":
    main()
