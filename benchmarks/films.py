"""What a film costs beside its run, in processor seconds.

python benchmarks/films.py [--camera CAMERA] [--processes N] [SCENARIO ...]

Each scenario is run by `omnitrack run --no-video` and its film is made by `omnitrack render`, at
1280 x 720 and 25 frames a second, in commands of their own, so that each count begins with the
imports. Without --camera a mission is filmed with `follow` and anything else with `side`, as by
`omnitrack run`. Printed are processor seconds (user and system, with all processes that the
commands started), wall seconds, and the ratio of film to run.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from shape import Arguments, table

from omnitrack_sim import load_scenario

SCENARIOS = ("tee_turn", "missions/fig14")


def measured(*words: object) -> tuple[float, float]:
    """Return the processor and wall seconds of a command of omnitrack."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "omnitrack_sim.cli", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime)
    return spent, wall


def row(name: str, camera: str | None, options: tuple[object, ...]) -> list[str]:
    """Run a scenario, film it, and return what both cost."""
    camera = camera or ("side" if load_scenario(name).mission is None else "follow")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "run"
        run, _ = measured("run", name, "--no-video", "--out", place)
        film, wall = measured("render", place, "--camera", camera, *options)
    return [f"`{name}`", f"`{camera}`", *(f"{x:.1f}" for x in (run, film, wall, film / run))]


def main() -> None:
    """Measure the scenarios and print the table."""
    arguments = Arguments(__doc__)
    arguments.add_argument("scenarios", nargs="*", metavar="SCENARIO", default=SCENARIOS)
    arguments.add_argument("--camera", choices=("side", "follow", "onboard"))
    arguments.add_argument("--processes", type=int)
    given = arguments.read()
    options = () if given.processes is None else ("--processes", given.processes)
    heads = ("scenario", "camera", "run, CPU s", "film, CPU s", "film, wall s", "film / run")
    table("cost", heads, (row(name, given.camera, options) for name in given.scenarios))


if __name__ == "__main__":
    main()
