"""How well a robot finds its way by camera.

python benchmarks/autonomy.py [--only STUDY ...] [--quick] [--trials N] [--senses SENSE ...]
    [--pictures one five] [--seed N] [--close SHARE] [--workers N] [--keep FOLDER]

`turns`: tee turns from any orientation, with friction 0.8 to 1.0, any gravity and any preload of 15
to 35 N, of robots that do not know how they are turned about their axis: by truth, depth and
headlight. `missions`: random networks of 6 to 12 fittings with a map, likewise. `robots`: the
presser and the climber through random networks that they can take. `unknown`: random networks
explored without a map.
`recognition`: random approaches to fittings, seen by both cameras in one picture and in five over
100 mm: how often the kind is right, how sure it was said to be, the errors of direction and
distance. The default seed is not the one that anything was tuned on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from driving import by_sensors, other_robots, unknown
from recognising.approaches import BORE, approach
from recognising.report import Found, by_case, by_distance, failures, summary
from shape import Arguments, run_tasks

from omnitrack_sim.autonomy.recognition import Recogniser
from omnitrack_sim.senses.cameras import DepthCamera, DepthTable, HeadlightCamera, HeadlightTable
from omnitrack_sim.senses.optics import Camera
from omnitrack_sim.walls.rays import RayWalls

TRIALS = {"turns": 200, "missions": 100, "robots": 30, "unknown": 50, "recognition": 2000}
QUICK_TRIALS, SEED = 10, 2
CAMERAS: dict[str, Callable[[], Any]] = {
    "depth": lambda: DepthCamera(DepthTable()),
    "headlight": lambda: HeadlightCamera(HeadlightTable()),
}
"""Cameras as scenarios have them by default."""
Task = tuple[str, bool, int, range, float]
"""Camera, whether all pictures of an approach are used, seed, approaches, and the share of ports
beyond a fitting on which another one follows directly."""


@cache
def _recogniser(name: str) -> tuple[Camera, Recogniser]:
    camera = CAMERAS[name]()
    return camera, Recogniser(camera, BORE, RayWalls)


def look(task: Task) -> list[Found]:
    """What a camera makes of some approaches."""
    name, every, seed, indices, close = task
    camera, recogniser = _recogniser(name)
    found = []
    for index in indices:
        trial = approach(seed, index, close)
        pictures = trial.pictures(camera)
        start = time.process_time()
        if every:
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


def recognition(
    trials: int,
    cameras: Sequence[str],
    pictures: Sequence[str],
    seed: int,
    workers: int,
    close: float,
) -> None:
    """Measure the recogniser and print the tables."""
    runs: dict[str, list[Found]] = {}
    for name in cameras:
        for every, words in ((False, "one picture"), (True, "five pictures")):
            if words.split()[0] not in pictures:
                continue
            tasks: list[Task] = [
                (name, every, seed, range(i, min(i + 20, trials)), close)
                for i in range(0, trials, 20)
            ]
            found = [f for part in run_tasks(look, tasks, workers) for f in part]
            runs[f"{name}, {words}"] = found
            print(f"{name}, {words}\n\n{by_case(found)}\n\n{failures(found)}\n", flush=True)
    print(f"{trials} approaches, seed {seed}\n")
    print(summary(runs))
    print(f"\n{by_distance(runs)}")


def main() -> None:
    """Run the studies that are asked for, and print their tables."""
    parser = Arguments(__doc__, seed=SEED, workers=True)
    parser.add_argument("--only", nargs="+", choices=tuple(TRIALS), default=list(TRIALS))
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_TRIALS} trials a study")
    parser.add_argument("--trials", type=int, help="trials a study")
    parser.add_argument(
        "--senses", nargs="+", choices=tuple(by_sensors.SENSES), default=list(by_sensors.SENSES)
    )
    parser.add_argument("--pictures", nargs="+", choices=("one", "five"), default=["one", "five"])
    parser.add_argument(
        "--close", type=float, default=0.0, help="share of fittings that others follow directly"
    )
    parser.add_argument(
        "--keep", type=Path, help="folder of explorations that are done, and not made again"
    )
    given = parser.read()
    for study in given.only:
        trials = given.trials or (QUICK_TRIALS if given.quick else TRIALS[study])
        if study == "recognition":
            cameras = [name for name in CAMERAS if name in given.senses]
            recognition(trials, cameras, given.pictures, given.seed, given.workers, given.close)
            continue
        every = study, given.senses, trials, given.seed, given.workers
        name = study
        if study == "unknown":
            # They take minutes each, so those of each camera may be made by a call of its own.
            name = " ".join([study, *given.senses])
            tours = unknown.runs(*every[1:], given.keep)
            table, failures = unknown.table(tours), unknown.failures(tours)
        elif study == "robots":
            others = other_robots.runs(*every[1:])
            table, failures = other_robots.table(others), other_robots.failures(others)
        else:
            drives = by_sensors.runs(*every)
            table, failures = by_sensors.table(drives), by_sensors.failures(drives)
        print(f"## {name}\n\n{trials} trials, seed {given.seed}:\n\n{table}\n")
        print(f"## failures of {name}\n\n{failures}\n", flush=True)


if __name__ == "__main__":
    main()
