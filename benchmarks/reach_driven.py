"""Predicted against driven: random routes through random networks that no passport was made of.

    python benchmarks/reach_driven.py PASSPORT [--routes 40] [--friction 0.6:0.9]

For each route the map of reach says how surely and how fast the robot gets to the far end; then the
mission is run in full. Printed are each route, the share of times within the predicted 95 %
interval, and the sum of passes beside the sum of probabilities with its standard deviation.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

import omnitrack_sim as ot
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.scenario import validate

SEED = 74_000
"""Of the first network; nothing else uses these."""


def draw(passport: ot.Passport, number: int, friction: tuple[float, float]) -> ot.Scenario:
    """Return a mission from one open end of a random network to another."""
    robot, generator = passport.robot, np.random.default_rng([SEED, number])
    bore = robot.nominal_bore
    network: Network = ot.random_network(
        SEED + number,
        int(generator.integers(5, 13)),
        lengths=(robot.length + 0.5 * bore, robot.length + 4 * bore),
        mean_radii=(bore, 1.5 * bore, 3 * bore),
        inner_diameter=bore,
    )
    start, goal = generator.choice(network.open_ends, 2, replace=False)
    tilt = generator.normal(size=3)
    data = {
        "name": f"route_{number}",
        "network": network.model_dump(mode="json"),
        "mission": {"start": str(start), "goals": [str(goal)]},
        "start": {
            "distance": robot.length / 2 + bore / 4,
            "theta5_deg": float(generator.uniform(-180, 180)),
        },
        "control": {"cruise_speed": robot.nominal_speed},
        "world": {
            "friction": float(generator.uniform(*friction)),
            "gravity": (9.81 * tilt / np.linalg.norm(tilt)).tolist(),
        },
    }
    return validate(data, changes=dict(passport.changes))


def main() -> None:
    """Predict and drive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("passport")
    parser.add_argument("--routes", type=int, default=40)
    parser.add_argument("--friction", default="0.6:0.9")
    options = parser.parse_args()
    low, high = map(float, options.friction.split(":"))
    passport = ot.load_passport(options.passport)
    sure, spread, passes, within, timed, unknown = 0.0, 0.0, 0, 0, 0, 0
    for number in range(options.routes):
        scenario = draw(passport, number, (low, high))
        network, mission = scenario.network, scenario.mission
        assert network is not None
        assert mission is not None
        friction = scenario.world.friction
        reach = ot.map_reach(
            network,
            passport,
            [mission.start],
            friction=(friction, friction),
            gravity=scenario.world.gravity,
        )
        last = mission.goals[0].rpartition(".")[0]
        row = next(part for part in reach.parts if part.name == last)
        if not row.launch:
            unknown += 1
            print(f"{number:3d} {row.stopped_by}")
            continue
        result = ot.run(scenario, no_load=False)
        # The robot begins and ends inside the first and the last pipe.
        ends = scenario.start.distance + scenario.robot.length / 2
        seconds = row.seconds - ends / scenario.control.cruise_speed
        # At least the rounding of a start and a stop.
        half = 1.96 * math.hypot(row.seconds_std, 0.5)
        inside = abs(result.duration_s - seconds) <= half
        print(
            f"{number:3d} p {row.probability:.2f} ({row.low:.2f} to {row.high:.2f}), "
            f"{result.outcome.value}; {seconds:.0f} +- {half:.0f} s, {result.duration_s:.0f} s",
            flush=True,
        )
        sure, spread = sure + row.probability, spread + row.probability * (1 - row.probability)
        passes += result.success
        timed += result.success
        within += result.success and inside
    print(f"{within} of {timed} times within their interval; {unknown} routes unknown")
    print(f"{passes} passes, {sure:.1f} +- {math.sqrt(spread):.1f} predicted")


if __name__ == "__main__":
    main()
