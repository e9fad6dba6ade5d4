"""Three robots that are to turn into the branch of the same tee, side by side.

python benchmarks/side_by_side.py --out FOLDER [--film]

side_by_side.png: stills at the same moments, a row a moment, with how each run ended below.
side_by_side.mp4 with --film: all of it. The course is that of the benchmark.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from shape import Arguments

import omnitrack_sim as ot
from omnitrack_sim.show.film.encoding import film
from omnitrack_sim.show.film.overlay import font
from omnitrack_sim.show.film.render import render_frames
from omnitrack_sim.trials.entries import robot_entry
from omnitrack_sim.trials.mobility import load_course

ROBOTS = ("omnitrack", "climber", "presser")
TIMES = (1.5, 3.0, 6.5)
"""Of the stills, s; then the robots are before the opening, beside it, and at their ends."""
PANEL = (360, 360)
FPS, LAST = 25, 1.0
"""Frames a second; how long the film shows the ends, s."""
HEAD, GAP = 30, 6
"""Pixels above each panel, and between them."""


def run_of(robot: str) -> ot.Result:
    """The run of a robot into the branch, friction 0.8."""
    changes = {**robot_entry(robot).changes, "world.friction": 0.8}
    return ot.run(load_course("tee_into").scenario(changes), no_load=False)


def panels_of(name: str, run: ot.Result, times: Sequence[float]) -> list[np.ndarray]:
    """Panels of one robot at each time, with a head line; at last with how the run ended."""
    width, height = PANEL
    options = {"width": width, "height": height, "inset": False, "overlay": False}
    moments = [min(time, run.duration_s) for time in times]
    panels = []
    for frame, time in zip(render_frames(run, times=moments, **options), moments, strict=True):
        panel = Image.new("RGB", (width + GAP, height + HEAD), "white")
        panel.paste(Image.fromarray(frame), (0, HEAD))
        words = run.outcome.value.replace("_", " ") if time == run.duration_s else "on its way"
        text = f"{name}: {words}, {time:.1f} s"
        ImageDraw.Draw(panel).text((4, 5), text, font=font(16), fill=(34, 38, 43))
        panels.append(np.asarray(panel))
    return panels


def rows_of(runs: Sequence[ot.Result], times: Sequence[float]) -> list[np.ndarray]:
    """Panels of all robots at each time, side by side."""
    columns = [panels_of(name, run, times) for name, run in zip(ROBOTS, runs, strict=True)]
    return [np.concatenate(row, axis=1) for row in zip(*columns, strict=True)]


def main() -> None:
    """Run the robots; write the picture, and the film if it is asked for."""
    parser = Arguments(__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--film", action="store_true")
    given = parser.read()
    given.out.mkdir(parents=True, exist_ok=True)
    runs = [run_of(robot) for robot in ROBOTS]
    for name, run in zip(ROBOTS, runs, strict=True):
        print(name, run.outcome.value, f"{run.duration_s:.1f} s")
    rows = rows_of(runs, TIMES)
    Image.fromarray(np.concatenate(rows)).save(given.out / "side_by_side.png", optimize=True)
    if given.film:
        end = max(run.duration_s for run in runs) + LAST
        frames = rows_of(runs, np.arange(0, end, 1 / FPS).tolist())
        height, width, _ = frames[0].shape
        with film(given.out / "side_by_side.mp4", width, height, FPS) as append:
            for frame in frames:
                append(frame)


if __name__ == "__main__":
    main()
