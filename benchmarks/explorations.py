"""Explores the shipped unknown networks, by the true pose and by camera.

python benchmarks/explorations.py [--missions N]
"""

from __future__ import annotations

import time

from driving.by_sensors import SENSES
from shape import Arguments, table

import omnitrack_sim as ot
from omnitrack_sim.record.events import ExplorationComplete

MISSIONS = ("missions/explore_onboard", "missions/explore_loop", "missions/explore_house")


def row(name: str, sense: str) -> list[str]:
    """Return how a mission ended, and how good its map is."""
    scenario = ot.override(ot.load_scenario(name), SENSES[sense] | {"record.pictures": False})
    begin = time.process_time()
    (result,) = ot.run_batch([scenario], no_load=False)
    spent, metrics = time.process_time() - begin, result.metrics
    difference = result.map_difference()
    assert difference is not None
    claims = any(isinstance(event, ExplorationComplete) for event in result.events)
    return [
        f"`{name}`",
        sense,
        f"`{result.outcome.value}`",
        f"{result.duration_s:.0f}",
        f"{metrics['distance_m']:.1f}",
        f"{difference.found} of {difference.parts}",
        "yes" if difference.same else "no",
        "yes" if claims else "no",
        f"{1000 * difference.length_error:.0f}",
        f"{spent:.0f}",
    ]


HEADS = (
    "run",
    "sensing",
    "outcome",
    "time, s",
    "driven, m",
    "parts found",
    "map right",
    "called complete",
    "lengths wrong, mm",
    "processor time, s",
)


def main() -> None:
    """Explore, and print the table."""
    missions = MISSIONS[: Arguments(__doc__, trials=len(MISSIONS), of="missions").read().missions]
    table("runs", HEADS, (row(name, sense) for name in missions for sense in ("truth", "depth")))


if __name__ == "__main__":
    main()
