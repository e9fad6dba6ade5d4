"""What a film costs beside its run, in processor seconds.

python benchmarks/films.py [--camera CAMERA] [--processes N] [SCENARIO ...]

Each scenario is run by `omnitrack run --no-video` and its film is made by `omnitrack render`, at
1280 x 720 and 25 frames a second, in commands of their own, so that each count begins with the
imports. Without --camera a mission is filmed with `follow` and anything else with `side`, as by
`omnitrack run`. Printed are processor seconds (user and system, with all processes that the
commands started), wall seconds, and the ratio of film to run.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from omnitrack_sim import load_scenario

SCENARIOS = ("tee_turn", "missions/fig14")


def measured(*words: object) -> tuple[float, float]:
    """Processor and wall seconds of a command of omnitrack."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "omnitrack_sim.cli", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime)
    return spent, wall


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", default=SCENARIOS)
    parser.add_argument("--camera", choices=("side", "follow", "onboard"))
    parser.add_argument("--processes", type=int)
    options = parser.parse_args()
    print("## cost\n\n| scenario | camera | run, CPU s | film, CPU s | film, wall s | film / run |")
    print("|---|---|---|---|---|---|")
    for name in options.scenarios:
        camera = options.camera or ("side" if load_scenario(name).mission is None else "follow")
        more = () if options.processes is None else ("--processes", options.processes)
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "run"
            run, _ = measured("run", name, "--no-video", "--out", place)
            film, wall = measured("render", place, "--camera", camera, *more)
        cells = (f"`{name}`", f"`{camera}`", *(f"{x:.1f}" for x in (run, film, wall, film / run)))
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
