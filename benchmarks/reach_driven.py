"""Predicted against driven: random routes that no passport was made of.

    python benchmarks/reach_driven.py PASSPORT [--town FILE] [--routes 40] [--friction 0.6:0.9]
        [--condition NAME] [--out FILE] [--quick]

Each route is driven in full; the map of reach says how surely and how fast the robot gets to its
far end. Without a town the routes lead through random networks at any gravity. With one, a network
file or one that can be imported, each leads through a random node or bend of it, over at least
three fittings and 5 to 40 m, and only the parts near it are put into the model; its first and last
straight are cut to length. With --condition (good, fair, poor or a file) the random networks are of
old pipes, whose straights are up to ten bores longer, so that joints find room.

What was driven is kept in ``--out``, a line a route: killed at any time, the same command goes on,
and with another passport it predicts again what was driven already. Printed are each route, the
share of times within the predicted 95 % interval, and the sum of passes beside the sum of
probabilities with its standard deviations: by chance, and of what the passport's trials leave open,
which errs alike on all routes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from shape import Arguments, random_gravity

import omnitrack_sim as ot
from omnitrack_sim.pipes import Port
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import ARCS
from omnitrack_sim.record.statistics import Z95
from omnitrack_sim.scenario import validate
from omnitrack_sim.trials.batches import sha256_of

SEED = 74_000
"""Of the first network; nothing else uses these."""
LENGTHS = (5.0, 40.0)
"""Shortest and longest route through a town, m."""
MIN_FITTINGS = 3
"""Fittings other than straights on a route through a town."""
THROUGH = ("elbow", "mitre", "tee", "wye", "cross")
"""Kinds of which a route through a town passes one, drawn as often as each other: most fittings of
a town are slight bends."""


class Walk(NamedTuple):
    """A stretch of a town, from its first to its last straight.

    Attributes:
        parts: indices, in order. first, last: what is left of its end straights, m.
        ends: ports at which it begins and ends.
    """

    parts: list[int]
    first: float
    last: float
    ends: tuple[Port, Port]


def through_random_network(
    robot: ot.Robot, seed: int, generator: np.random.Generator, condition: str | None
) -> tuple[Network, str, str, list[float]]:
    """Return a random network, two of its open ends, and gravity in any direction."""
    bore = robot.nominal_bore
    network: Network = ot.random_network(
        seed,
        int(generator.integers(5, 13)),
        lengths=(robot.length + 0.5 * bore, robot.length + (4 if condition is None else 14) * bore),
        mean_radii=(bore, 1.5 * bore, 3 * bore),
        inner_diameter=bore,
        condition=condition,
    )
    start, goal = generator.choice(network.open_ends, 2, replace=False)
    return network, str(start), str(goal), random_gravity(generator)


class Town:
    """A network of many parts, through which random routes are drawn for a robot."""

    def __init__(self, network: Network, robot: ot.Robot) -> None:
        self.network, self.robot = network, robot
        self.joined: dict[Port, Port] = {}
        for a, b in network.pipes.joints:
            self.joined[a], self.joined[b] = b, a
        self.fittings = [part.fitting for part in network.pipes.parts]

    def draw(self, generator: np.random.Generator) -> tuple[Network, str, str]:
        """Return the parts near a random route, and the open ends that it leads from and to."""
        kind = generator.choice(THROUGH)
        parts = [i for i, f in enumerate(self.fittings) if f.kind == kind and self._may_pass(i)]
        while True:
            part = int(generator.choice(parts))
            walk = self._walk(part, float(generator.uniform(*LENGTHS)), generator)
            kinds = [self.fittings[i].kind for i in walk.parts] if walk else []
            if walk and len(kinds) - kinds.count("straight") >= MIN_FITTINGS:
                return self._cut_out(walk)

    def _may_pass(self, part: int) -> bool:
        """Tell whether the robot fits two ports of a part, of which the others may be narrower."""
        return len(self._ports(part)) >= 2

    def _walk(self, part: int, length: float, generator: np.random.Generator) -> Walk | None:
        """Walk to both sides of a part; nothing where either ends before a straight."""
        ports = self._ports(part)
        enter, leave = (str(port) for port in generator.choice(ports, 2, replace=False))
        share = generator.uniform(0.2, 0.8)
        sides = []
        for port, room in ((enter, share * length), (leave, (1 - share) * length)):
            side = self._onward((part, port), room, generator)
            if side is None:
                return None
            sides.append(side)
        (back, first, begin), (ahead, last, end) = sides
        order = [*back[::-1], part, *ahead]
        whole = len(set(order)) == len(order)
        return Walk(order, first, last, (begin, end)) if whole else None

    def _ports(self, part: int) -> list[str]:
        """Return the ports of a part that the robot fits."""
        fitting = self.fittings[part]
        ports = fitting.port_names
        return [port for port in ports if not self.robot.misfit(2 * fitting.port_radius(port))]

    def _onward(
        self, leave: Port, room: float, generator: np.random.Generator
    ) -> tuple[list[int], float, Port] | None:
        """Walk on from a port by ``room`` m, and end inside a straight.

        Returns:
            The parts, how long a piece of the last is walked, m, and its far port.
        """
        parts: list[int] = []
        least = self.robot.length + self.robot.nominal_bore
        while (enter := self.joined.get(leave)) is not None and self._may_pass(enter[0]):
            part, fitting = enter[0], self.fittings[enter[0]]
            ports = [port for port in self._ports(part) if port != enter[1]]
            if not ports or fitting.kind == "cap":
                return None
            port = str(generator.choice(ports))
            length = fitting.axis_curve(enter[1], port, ARCS).length
            parts.append(part)
            if fitting.kind == "straight" and length >= max(room, least):
                return parts, max(room, least), (part, port)
            room, leave = room - length, (part, port)
        return None

    def _cut_out(self, walk: Walk) -> tuple[Network, str, str]:
        """Return the parts near a walk, whose end straights are as long as they are walked."""
        town = self.network
        names = [town.fittings[i].name for i in walk.parts]
        beyond = {
            town.fittings[self.joined[end][0]].name for end in walk.ends if end in self.joined
        }
        near = town.around(names, without=beyond - set(names))
        data = near.model_dump(mode="json")
        for fitting in data["fittings"]:
            for name, length in ((names[0], walk.first), (names[-1], walk.last)):
                if fitting["name"] == name:
                    fitting["length"] = length
        start, goal = (town.port_name(end) for end in walk.ends)
        return Network.model_validate(data), start, goal


def routes(
    passport: ot.Passport,
    town: Network | None,
    friction: tuple[float, float],
    seed: int = SEED,
    condition: str | None = None,
) -> Iterator[tuple[int, ot.Scenario]]:
    """Yield missions from one open end of a network to another, without end."""
    robot = passport.robot
    drawn = None if town is None else Town(town, robot)
    for number in count():
        generator, gravity = np.random.default_rng([seed, number]), [0.0, 0.0, -9.81]
        if drawn is None:
            made = through_random_network(robot, seed + number, generator, condition)
            network, start, goal, gravity = made
        else:
            network, start, goal = drawn.draw(generator)
        data = {
            "name": f"route_{number}",
            "network": network.model_dump(mode="json"),
            "mission": {"start": start, "goals": [goal]},
            "start": {
                "distance": robot.length / 2 + robot.nominal_bore / 4,
                "theta5_deg": float(generator.uniform(-180, 180)),
            },
            "control": {"cruise_speed": robot.nominal_speed},
            "world": {"friction": float(generator.uniform(*friction)), "gravity": gravity},
        }
        yield number, validate(data, changes=dict(passport.changes))


def predict(passport: ot.Passport, scenario: ot.Scenario) -> ot.PipeReach:
    """Return the reach of the last part of a mission."""
    network, mission, world = scenario.network, scenario.mission, scenario.world
    assert network is not None
    assert mission is not None
    friction = (world.friction, world.friction)
    reach = ot.map_reach(
        network, passport, [mission.start], friction=friction, gravity=world.gravity
    )
    last = mission.goals[0].rpartition(".")[0]
    return next(part for part in reach.parts if part.name == last)


def drive(scenario: ot.Scenario) -> dict[str, Any]:
    """Run a mission; what is kept of it."""
    result = ot.run(scenario, no_load=False)
    kinds = [passage.kind for passage in scenario.route.passages]
    return {
        "outcome": result.outcome.value,
        "success": result.success,
        "seconds": result.duration_s,
        "length": scenario.route.length,
        "fittings": {kind: kinds.count(kind) for kind in sorted({*kinds} - {"straight"})},
    }


def driven_before(file: Path | None) -> dict[int, dict[str, Any]]:
    """Return what a file keeps by the routes' numbers; a line that a kill cut off goes."""
    if file is None or not file.exists():
        return {}
    lines = [line for line in file.read_text().splitlines(keepends=True) if line[-1] == "\n"]
    file.write_text("".join(lines))
    return {row["number"]: row for row in map(json.loads, lines)}


def main() -> None:
    """Predict and drive."""
    parser = Arguments(__doc__, trials=40, quick=3, of="routes", seed=SEED)
    parser.add_argument("passport")
    parser.add_argument("--town", metavar="FILE")
    parser.add_argument("--friction", default="0.6:0.9")
    parser.add_argument("--condition", metavar="NAME")
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON, a line a route")
    options = parser.read()
    low, high = map(float, options.friction.split(":"))
    passport, town = ot.load_passport(options.passport), None
    if options.town:
        is_ours = Path(options.town).suffix == ".toml"
        town = ot.load_network(options.town) if is_ours else ot.import_network(options.town).network
    out: Path | None = options.out
    driven = driven_before(out)
    sure, spread, doubt, passes, within, known, unknown = 0.0, 0.0, 0.0, 0, 0, 0, 0
    for number, scenario in routes(passport, town, (low, high), options.seed, options.condition):
        if known == options.routes:
            break
        row = predict(passport, scenario)
        if not row.launch:
            unknown += 1
            print(f"{number:3d} {row.stopped_by}")
            continue
        # What was driven through other pipes does not count.
        pipes = sha256_of(scenario.model_dump(mode="json"))
        if driven.get(number, {}).get("pipes") != pipes:
            driven[number] = {"number": number, "pipes": pipes, **drive(scenario)}
            if out is not None:
                with out.open("a") as file:
                    file.write(json.dumps(driven[number]) + "\n")
        run, friction = driven[number], scenario.world.friction
        # The robot begins and ends inside the first and the last pipe.
        ends = (scenario.start.distance + scenario.robot.length / 2) / scenario.control.cruise_speed
        # At least the rounding of a start and a stop.
        half = Z95 * math.hypot(row.seconds_std, 0.5)
        seconds = row.seconds - ends
        inside = abs(run["seconds"] - seconds) <= half
        parts = ", ".join(f"{n} {kind}" for kind, n in run["fittings"].items())
        print(
            f"{number:3d} {run['length']:5.1f} m, {parts}; friction {friction:.2f}, "
            f"p {row.probability:.2f} ({row.low:.2f} to {row.high:.2f}), {run['outcome']}; "
            f"worst {row.stopped_by or 'nothing'}; "
            f"{seconds:.0f} +- {half:.0f} s, {run['seconds']:.1f} s"
            + ("" if inside else " (outside)"),
            flush=True,
        )
        sure, spread = sure + row.probability, spread + row.probability * (1 - row.probability)
        doubt += (row.probability - row.low) / Z95
        passes += run["success"]
        known += 1
        within += run["success"] and inside
    print(f"{within} of {passes} times within their interval; {unknown} routes unknown")
    print(
        f"{passes} of {known} pass, {sure:.1f} +- {math.sqrt(spread):.1f} +- {doubt:.1f} predicted"
    )


if __name__ == "__main__":
    main()
