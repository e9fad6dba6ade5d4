"""Draws the presser, the inchworm, the snake on their way up an elbow and over a tee.

python benchmarks/other_stills.py --out FOLDER

presser.png, inchworm.png, snake.png: four stills each, with the pipes cut away and the walls'
forces.
"""

from __future__ import annotations

import sys
from pathlib import Path

from shape import Arguments

import omnitrack_sim as ot
from omnitrack_sim.robots.inchworm import Inchworm
from omnitrack_sim.robots.presser import Presser
from omnitrack_sim.robots.snake import Snake

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from in_pipes import Drive, pipe

ROBOTS = {"presser": (Presser, 0.2), "inchworm": (Inchworm, 0.3), "snake": (Snake, 0.35)}
"""Each robot, and the arc length, m, at which its chassis begins."""
PLACES = 0.35, 0.65, 1.05, 1.35
"""Arc lengths of the chassis: in the riser, the elbow, beside the branch and behind it, m."""


def main() -> None:
    """Drive each robot and write its stills."""
    parser = Arguments(__doc__)
    parser.add_argument("--out", type=Path, required=True)
    folder = parser.read().out
    folder.mkdir(parents=True, exist_ok=True)
    course = pipe("elbow", "tee", turns=[0, 180])
    for name, (kind, start) in ROBOTS.items():
        robot = kind()
        drive = Drive(robot, course, s=start)
        recording = ot.Recording(drive.model, drive.pipes, body=robot.chassis, period=0.0)
        for place in PLACES:
            drive.run(60.0, until=place)
            recording.append(drive.data)
        path = folder / f"{name}.png"
        look = {"camera": "follow", "width": 480, "height": 400}
        ot.render_strip(recording, path=path, times=recording.time, **look)


if __name__ == "__main__":
    main()
