"""How well fittings are recognised by camera, in random approaches.

python benchmarks/recognition.py [--trials N] [--quick] [--senses depth headlight]
    [--pictures one five] [--close SHARE] [--seed N] [--workers N]

Drawn are approaches to fittings, seen by both cameras in one picture and in five over 100 mm; of
--close fittings other ones follow directly. Printed is how often the kind is right, how sure it was
said to be, and the errors of direction and distance. The default seed is not the one that anything
was tuned on.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any

from recognising.approaches import BORE, approach
from recognising.report import Found, by_case, by_distance, failures, summary
from shape import Arguments, run_tasks

from omnitrack_sim.autonomy.recognition import Recogniser
from omnitrack_sim.senses.cameras import DepthCamera, DepthTable, HeadlightCamera, HeadlightTable
from omnitrack_sim.senses.optics import Camera
from omnitrack_sim.walls.rays import RayWalls

CAMERAS: dict[str, Callable[[], Any]] = {
    "depth": lambda: DepthCamera(DepthTable()),
    "headlight": lambda: HeadlightCamera(HeadlightTable()),
}
"""Cameras as scenarios have them by default."""
PICTURES = {"one": "one picture", "five": "five pictures"}
TOGETHER = 20
"""Approaches of a task."""
Task = tuple[str, str, int, range, float]
"""Camera, pictures of an approach, seed, approaches, and the share of ports beyond a fitting on
which another one follows directly."""


@cache
def _recogniser(name: str) -> tuple[Camera, Recogniser]:
    camera = CAMERAS[name]()
    return camera, Recogniser(camera, BORE, RayWalls)


def look(task: Task) -> list[Found]:
    """What a camera makes of some approaches."""
    name, number, seed, indices, close = task
    camera, recogniser = _recogniser(name)
    found = []
    for index in indices:
        trial = approach(seed, index, close)
        pictures = trial.pictures(camera)
        start = time.process_time()
        if number == "five":
            sighting = recogniser.approach(pictures, trial.motions)
        else:
            sighting = recogniser.single(pictures[-1])
        seconds = time.process_time() - start
        told = f"{sighting.kind} {sighting.enter}".strip()
        found.append(
            Found(
                index,
                trial.case,
                trial.distance,
                repr(trial.fitting),
                told,
                trial.is_right(sighting),
                sighting.confidence,
                trial.turn_error(sighting),
                sighting.distance - trial.distance,
                seconds,
            )
        )
    return found


def main() -> None:
    """Look, and print the tables."""
    parser = Arguments(__doc__, trials=2000, quick=10, seed=2, workers=True)
    parser.add_argument("--senses", nargs="+", choices=tuple(CAMERAS), default=[*CAMERAS])
    parser.add_argument("--pictures", nargs="+", choices=tuple(PICTURES), default=[*PICTURES])
    parser.add_argument(
        "--close", type=float, default=0.0, help="share of fittings that others follow directly"
    )
    given = parser.read()
    runs: dict[str, list[Found]] = {}
    for name in given.senses:
        for number in given.pictures:
            tasks: list[Task] = [
                (name, number, given.seed, range(i, min(i + TOGETHER, given.trials)), given.close)
                for i in range(0, given.trials, TOGETHER)
            ]
            runs[f"{name}, {PICTURES[number]}"] = found = [
                one for part in run_tasks(look, tasks, given.workers) for one in part
            ]
            print(f"## {name}, {PICTURES[number]}\n\n{by_case(found)}\n\n{failures(found)}\n")
    print(f"## recognition\n\n{given.trials} approaches, seed {given.seed}\n\n{summary(runs)}")
    print(f"\n{by_distance(runs)}")


if __name__ == "__main__":
    main()
