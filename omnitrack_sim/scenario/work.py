"""How much work a scenario asks for: physics steps, samples, pieces of wall, against their
bounds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from omnitrack_sim.base.bounds import MOST_PIECES, MOST_SAMPLES, MOST_STEPS
from omnitrack_sim.base.errors import Fault
from omnitrack_sim.scenario.tables import ControlTable, PhysicsTable

if TYPE_CHECKING:
    from omnitrack_sim.scenario.model import Scenario

EXPLORED = 8.0
"""Ways of all its legs that a robot which explores drives, in lengths of the network, and with it
the time that it has."""


def samples_of(scenario: Scenario) -> int:
    """Most samples that a run records, up to its time limit."""
    return math.ceil(most_seconds(scenario) / scenario.record.period)


def most_seconds(scenario: Scenario) -> float:
    """Simulated time limit of a run, s; of a mission that of all its legs if nothing is in the
    way."""
    planner, exploration = scenario.planner, scenario.exploration
    if exploration is not None:
        return scenario.time_limit_s + scenario.time_for(EXPLORED * exploration.network.length)
    more = [] if planner is None else planner.plan()[1:]
    lengths = [] if planner is None else [planner.length(leg) for leg in more]
    return scenario.time_limit_s + sum(scenario.time_for(length) for length in lengths)


def too_much_work(scenario: Scenario) -> Iterator[Fault]:
    """Figures of a scenario that go beyond the bounds, at the key that is to be changed."""
    physics, seconds = scenario.physics, most_seconds(scenario)
    where = _unusual(scenario)
    asked = f"makes {{:.4g}} {{}} in a time limit of {seconds:.4g} s{_origin(scenario, where)}"
    steps = seconds / physics.timestep
    if steps > MOST_STEPS:
        told = asked.format(steps, "time steps")
        yield Fault(where, f"{told}; at most {MOST_STEPS:,}")
    elif (samples := samples_of(scenario)) > MOST_SAMPLES:
        told = asked.format(samples, "samples")
        yield Fault("record.period", f"{told}; at most {MOST_SAMPLES:,}")
    yield from _too_many_pieces(scenario)


def _too_many_pieces(scenario: Scenario) -> Iterator[Fault]:
    """The fault of walls of primitives of too many pieces."""
    physics = scenario.physics
    if physics.collider != "primitives":
        return
    parts = scenario.route.network.parts
    pieces = sum(part.fitting.piece_count(physics.wall_tolerance, physics.staves) for part in parts)
    if pieces > MOST_PIECES:
        problem = f"makes walls of about {pieces:,} pieces; at most {MOST_PIECES:,}"
        yield Fault(
            _finest(scenario), f'{problem} (physics.collider = "exact" makes one a fitting)'
        )


def _finest(scenario: Scenario) -> str:
    """The key that makes the walls fine, or that of the pipes."""
    if scenario.physics.staves is not None:
        return "physics.staves"
    if scenario.physics.wall_tolerance < PhysicsTable().wall_tolerance:
        return "physics.wall_tolerance"
    return "pipes" if scenario.pipes else "network.fittings"


def _origin(scenario: Scenario, where: str) -> str:
    """Where the time limit comes from, unless that is the key ``where`` itself."""
    if scenario.run.time_limit is not None:
        return "" if where == "run.time_limit" else " (run.time_limit)"
    return f" at a cruise speed of {scenario.control.cruise_speed:.4g} m/s"


def _unusual(scenario: Scenario) -> str:
    """The key that is farthest from its default among those that make many time steps."""
    slow = ControlTable().cruise_speed / scenario.control.cruise_speed
    fine = PhysicsTable().timestep / scenario.physics.timestep
    if fine >= 10 and fine >= slow:
        return "physics.timestep"
    if scenario.run.time_limit is not None:
        return "run.time_limit"
    if slow >= 10:
        return "control.cruise_speed"
    return "pipes" if scenario.pipes else "mission.goals"
