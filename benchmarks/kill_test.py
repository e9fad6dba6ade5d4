"""Kills commands at all moments of their lives, and looks at what is there afterwards.

python benchmarks/kill_test.py [--quick] [--kills N] [--only NAME]

``run`` (with and without a film), ``render``, ``reproduce --quick`` and ``reach`` replace an
earlier output. Half of their kills come right before a change of a file, the other half at random
times. After each one the earlier output or the new one must be there whole, and after the next
undisturbed start the new one and nothing beside it. A sweep, a benchmark and a passport are killed
and resumed until they are done, and must leave the files of an undisturbed one. Ends with status 1
where anything is lost or left.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from killing.outputs import Subject, Trial
from killing.sweep import FILES, kill_trials


def _run(friction: float, *more: str) -> tuple[str, ...]:
    short = ("--set", "run.time_limit=0.3", "--set", f"world.friction={friction}")
    return ("run", "straight", *short, "--out", "out/run", *more)


def _reach(friction: str) -> tuple[str, ...]:
    return ("reach", "fig14", "--friction", friction, "--out", "out/reach")


def _loads_reach(out: Path) -> object:
    return json.loads((out / "reach" / "reach.json").read_text(encoding="utf-8"))


def _loads_run(out: Path) -> object:
    from omnitrack_sim import load_result

    return load_result(out / "run").timeline()


def _loads_claims(out: Path) -> object:
    return json.loads((out / "reproduce" / "claims.json").read_text(encoding="utf-8"))


_PLAIN, _FILM = ("--no-video",), ("render", "out/run", "--out", "out/film.mp4", "--camera")
_PAPER = ("reproduce", "--quick", "--out", "out/reproduce", "--format")
SUBJECTS = {
    "run": Subject("run", (_run(0.9, *_PLAIN),), _run(0.7, *_PLAIN), _loads_run, True),
    "film": Subject("run with a film", (_run(0.9),), _run(0.7), _loads_run, True),
    "render": Subject(
        "render", (_run(0.9, *_PLAIN), (*_FILM, "onboard")), (*_FILM, "side"), _loads_run
    ),
    "reach": Subject("reach", (_reach("0.5:0.8"),), _reach("0.6:0.9"), _loads_reach),
    "reproduce": Subject(
        "reproduce",
        ((*_PAPER, "png"),),
        (*_PAPER, "svg"),
        _loads_claims,
        draws=True,
        remembers=True,
        statuses=(0, 1),  # 1 where a verdict has changed
    ),
}
SHARES = {"run": 14, "film": 8, "render": 10, "reproduce": 8, "reach": 10}
SHARES |= {"sweep": 20, "bench": 6, "passport": 10}
"""How often each is killed; 50 kills without those of trials."""
QUICK = {"run": 4, "render": 2}


def main() -> int:
    """Kill, look, tell."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="about a minute: run and render only")
    parser.add_argument("--only", choices=[*SUBJECTS, *FILES])
    parser.add_argument("--kills", type=int, metavar="N", help="of each")
    parser.add_argument("--trials", type=int, default=1000, help="of the sweep, or of each course")
    parser.add_argument("--workers", type=int, default=2, help="of the sweep")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    shares = QUICK if given.quick else SHARES
    faults: list[str] = []
    for name in shares if given.only is None else (given.only,):
        kills = shares.get(name, 2) if given.kills is None else given.kills
        with tempfile.TemporaryDirectory() as place:
            if name in FILES:
                sizes = (given.trials, given.workers)
                faults += kill_trials(name, Path(place), kills, given.seed, *sizes)
            else:
                faults += Trial(SUBJECTS[name], Path(place) / name).kill_often(kills, given.seed)
    print("nothing lost, nothing left" if not faults else f"{len(faults)} faults:")
    for fault in faults:
        print(f"  {fault}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
