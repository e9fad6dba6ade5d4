"""What a step costs in longer and longer networks.

python benchmarks/network_length.py [--quick]

A tee turn whose branch goes on as a long chain of straights, so that the walls count 500, 5,000 and
20,000 pieces. The robot stays in the tee. Prints microseconds of physics a step and of control a
trial and control step: with walls of primitives, the same without passing over what never moves,
and with the exact collider. Least of three measurements, which take turns because the machine's
speed varies.

A second table has the same turn, gravity along the entry, on a mission through a random network of
50 fittings, and how much more it costs than in one tee.
"""

from __future__ import annotations

import argparse
from itertools import permutations

from shares import timed

from omnitrack_sim import (
    Scenario,
    Simulation,
    load_scenario,
    override,
    random_network,
    shortest_route,
)
from omnitrack_sim.robots.omnitrack import track_plant
from omnitrack_sim.scenario import validate

PIECES = (500, 5_000, 20_000)
SEGMENT = 0.5
"""Length of a straight of the chain, m; 48 pieces each."""
STAVES = 48
NETWORK_SEED, NETWORK_FITTINGS = 0, 50
BEFORE = 0.23
"""Distance from the robot's centre to the tee's opening at the start, m.

Lugs then touch run and rim while the turn begins.
"""
MEASUREMENTS = 3
TRIALS, STEPS = 8, 60
VARIANTS = {
    "primitives": ("primitives", track_plant.SLEEP_FROM),
    "primitives, nothing passed over": ("primitives", 10**9),
    "exact": ("exact", track_plant.SLEEP_FROM),
}


def long_scenario(pieces: int, collider: str) -> Scenario:
    """The tee turn, with so many straights behind it that they make ``pieces`` pieces of wall."""
    data = load_scenario("tee_turn").model_dump(mode="json")
    pieces_of_walls = override(load_scenario("tee_turn"), {"physics.collider": "primitives"})
    have = len(pieces_of_walls.to_spec().geoms)
    data["pipes"] += [
        {"kind": "straight", "length": SEGMENT}
        for _ in range(max(0, round((pieces - have) / STAVES)))
    ]
    data["physics"]["collider"] = collider
    data["run"]["time_limit"] = 1000.0
    data["start"]["distance"] = load_scenario("tee_turn").route.passages[1].opening[0] - BEFORE
    data["control"]["align"] = False
    return validate(data)


def network_scenario(collider: str) -> Scenario:
    """The same turn at an open end of a random network, with gravity back along the entry."""
    network = random_network(NETWORK_SEED, NETWORK_FITTINGS)
    for start, goal in permutations(network.open_ends, 2):
        route = shortest_route(network, start, goal)
        first, second = route.passages[:2]
        if second.kind == "tee" and second.leave == "branch" and second.opening[0] - BEFORE > 0.1:
            break
    else:
        raise RuntimeError(f"no turn at an open end of the network of seed {NETWORK_SEED}")
    along = -network.pipes.parts[first.index].port(first.enter).rotation[:, 2]
    return validate(
        {
            "network": network,
            "mission": {"start": start, "goals": [goal]},
            "start": {"distance": second.opening[0] - BEFORE},
            "world": {"gravity": (-9.81 * along).tolist()},
            "control": {"align": False},
            "physics": {"collider": collider},
            "run": {"time_limit": 1000.0},
        }
    )


def cost(scenario: Scenario) -> tuple[float, float]:
    """Microseconds of physics a step, and of control a trial and control step.

    Measured over the first steps of a batch.
    """
    physics = scenario.physics
    shares = timed(Simulation([scenario] * TRIALS), STEPS)
    substeps = STEPS * round(physics.control_period / physics.timestep)
    return 1e6 * shares.physics / (substeps * TRIALS), 1e6 * shares.control / (STEPS * TRIALS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="up to 5,000 pieces")
    sizes = PIECES[:2] if parser.parse_args().quick else PIECES
    print("| pieces | fittings | walls | physics, us a step | control, us a step and trial |")
    print("|---|---|---|---|---|")
    for pieces in sizes:
        least: dict[str, tuple[float, float]] = {}
        fittings = 0
        for _ in range(MEASUREMENTS):
            for name, (collider, sleep_from) in VARIANTS.items():
                track_plant.SLEEP_FROM = sleep_from
                scenario = long_scenario(pieces, collider)
                fittings = len(scenario.pipes)
                found = cost(scenario)
                old = least.get(name, (float("inf"), float("inf")))
                least[name] = (min(old[0], found[0]), min(old[1], found[1]))
        for name, (physics, control) in least.items():
            print(f"| {pieces:,} | {fittings} | {name} | {physics:.1f} | {control:.1f} |")
    track_plant.SLEEP_FROM = VARIANTS["primitives"][1]
    print(
        f"\n| walls | part | one tee, us | random network of {NETWORK_FITTINGS} fittings, us | "
        "ratio |"
    )
    print("|---|---|---|---|---|")
    for collider in ("primitives", "exact"):
        runs = {"tee": long_scenario(0, collider), "network": network_scenario(collider)}
        found = {name: [] for name in runs}
        for _ in range(MEASUREMENTS):
            for name, scenario in runs.items():
                found[name].append(cost(scenario))
        for i, part in enumerate(("physics, a step", "control, a step and trial")):
            tee, network = (min(costs[i] for costs in found[name]) for name in runs)
            print(f"| {collider} | {part} | {tee:.1f} | {network:.1f} | {network / tee:.2f} |")


if __name__ == "__main__":
    main()
