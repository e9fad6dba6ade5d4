"""Batch key, start values and control settings of a batch of scenarios."""

from __future__ import annotations

import copy
import functools
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.rotations import quaternion_from_matrix
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.robots.control import Settings
from omnitrack_sim.robots.kinds import DEFAULT, robot_class
from omnitrack_sim.robots.plant import Start
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.tables import PhysicsTable

EACH: Mapping[str, str] = {
    "distance": "start.distance",
    "theta5_deg": "start.theta5_deg",
    "roll_deg": "start.roll_deg",
    "gravity": "world.gravity",
    "friction": "world.friction",
    "cruise_speed": "control.cruise_speed",
    "align": "control.align",
    "retry": "control.retry",
    "speed_limit": "control.speed_limit",
    "safe_margin_deg": "control.safe_margin_deg",
    "parameters": "control.parameters",
    "time_limit": "run.time_limit",
    "pull": "pull.force",
    "pull_rate": "pull.rate",
}
"""Values that may differ between the scenarios of a batch, by name and dotted path; beside those of
the robot, ``Robot.own_values``."""
CARRIED = (
    "name",
    "seed",
    "run.goal_distance",
    "run.expected_outcome",
    "mission.start",
    "mission.goals",
    "mission.avoid",
)
"""Keys that may differ within a batch but do not affect stepping."""


def batch_key(data: Mapping[str, Any]) -> str:
    """Return the text that scenarios of one batch have in common: all values but each one's own.

    Args:
        data: a scenario as plain data with every key. It need not be valid, and no route is built.
    """
    shared = copy.deepcopy(dict(data))
    for path in _own_paths(robot_kind(data)):
        _remove(shared, path.split("."))
    # Sorted, so that the order of keys in a file does not part what belongs together.
    return json.dumps(shared, sort_keys=True)


def _remove(place: Any, keys: Sequence[str]) -> None:
    """Remove what is at a path of a table, a ``*`` in which stands for any key."""
    if not isinstance(place, dict):
        return
    key, *inner = keys
    if not inner:
        place.pop(key, None)
        return
    for table in place.values() if key == "*" else [place.get(key)]:
        _remove(table, inner)


def _own_paths(kind: str) -> tuple[str, ...]:
    """Dotted paths of values in which scenarios of one batch may differ, with a kind of robot."""
    try:
        return _paths_of(kind)
    except InputError:  # told where the scenario is read; its code may be trusted later
        return (*EACH.values(), *CARRIED)


@functools.cache
def _paths_of(kind: str) -> tuple[str, ...]:
    values = robot_class(kind).own_values
    return (*EACH.values(), *CARRIED, *(f"robot.{path}" for path in values))


def robot_kind(data: Mapping[str, Any]) -> str:
    """Return the kind of robot of a scenario's plain data."""
    return str(data.get("robot", {}).get("kind", DEFAULT))


def is_shared(path: str, kind: str) -> bool:
    """Return whether scenarios of a batch, with robots of a kind, share the value at a path."""
    return not _is_among(path, _own_paths(kind))


@functools.cache
def _is_among(path: str, paths: tuple[str, ...]) -> bool:
    return any(_is_in(path.split("."), own.split(".")) for own in paths)


def _is_in(keys: Sequence[str], own: Sequence[str]) -> bool:
    """Return whether a path leads to what is at another one, or below."""
    return len(keys) >= len(own) and all(b in ("*", a) for a, b in zip(keys, own, strict=False))


def each(scenarios: Sequence[Scenario], name: str) -> NDArray:
    """One value of ``EACH`` of all scenarios, (n, ...); None is not a number."""
    path = EACH[name].split(".")
    values = [functools.reduce(getattr, path, scenario) for scenario in scenarios]
    return np.array([np.nan if value is None else value for value in values])


def start_of(scenarios: Sequence[Scenario], routes: RouteMap, route: NDArray[np.intp]) -> Start:
    """Start values and physical constants of each robot; ``route`` (n,): its route."""
    theta5 = np.radians(each(scenarios, "theta5_deg"))
    position, rotation = routes.start_poses(route, each(scenarios, "distance"), theta5)
    return Start(
        position=position,
        quaternion=quaternion_from_matrix(rotation),
        friction=each(scenarios, "friction"),
        gravity=each(scenarios, "gravity").astype(float),
        bore_radius=np.array([routes.routes[w].passages[0].radius for w in route]),
        roll=np.radians(each(scenarios, "roll_deg")),
        robots=[scenario.robot for scenario in scenarios],
    )


def settings_of(scenarios: Sequence[Scenario]) -> tuple[Settings, list[list[str]]]:
    """Return control settings of each robot, and notes where they differ from its scenario.

    Robots cruise at what the motor holds, and slow down in bends, whose outer side is longer than
    the centreline (``Settings.speed_in``). Belts are capped at what the motor holds.
    """
    notes = []
    highest = np.array([s.robot.top_speed for s in scenarios])
    for scenario in scenarios:
        bores = [2 * radius for radius in scenario.bores.values()]
        own = scenario.robot.notes(bores, scenario.physics.timestep)
        idle = _idle_note(scenario.physics)
        notes.append([*_speed_note(scenario), *own, *idle, *_still_note(scenario)])
    settings = Settings(
        cruise_speed=np.minimum(each(scenarios, "cruise_speed"), highest),
        min_cruise_speed=np.array([s.min_cruise_speed for s in scenarios]),
        top_speed=highest,
        align=each(scenarios, "align"),
        retry=each(scenarios, "retry"),
        speed_limit=np.minimum(each(scenarios, "speed_limit"), highest),
        safe_margin=np.radians(each(scenarios, "safe_margin_deg").astype(float)),
    )
    return settings, notes


def _speed_note(scenario: Scenario) -> Iterator[str]:
    """Cause that keeps a robot from its cruise speed, and the key that would raise it."""
    wanted, limit = scenario.control.cruise_speed, scenario.control.speed_limit
    most, slowest = scenario.robot.top_speed, scenario.min_cruise_speed
    if wanted <= min(limit, slowest):
        return
    motor = f"{scenario.robot.drive_name} holds {most:.4g} m/s"
    if slowest < most:
        motor += (
            ", and in the sharpest bend the outer side of the robot needs "
            f"{1 + scenario.sharpest_bend:.2f} times its speed"
        )
    lowered = f"cruise speed lowered from {wanted:.4g}"
    if limit < slowest:
        note = f"{lowered} to {limit:.4g} m/s: control.speed_limit caps the drive there"
        if slowest < wanted:
            note += f"; without it {slowest:.4g} m/s are possible: {motor}"
        yield note
    elif wanted <= most:
        yield f"{lowered} to {slowest:.4g} m/s in bends: {motor}"
    else:
        bends = f", and to {slowest:.4g} m/s in bends" if slowest < most else ""
        yield f"{lowered} to {most:.4g} m/s{bends}: {motor}"


def _idle_note(physics: PhysicsTable) -> Iterator[str]:
    """Keys of walls of primitives in a run with exact walls."""
    default = PhysicsTable()
    for key in ("wall_tolerance", "staves"):
        if physics.collider == "exact" and getattr(physics, key) != getattr(default, key):
            yield (
                f"physics.{key} has no effect on exact walls; it is for physics.collider = "
                '"primitives"'
            )


def _still_note(scenario: Scenario) -> Iterator[str]:
    """Yield a remark on a robot with actuators and without anything that commands them."""
    robot = scenario.robot
    gait = type(robot).gait
    if scenario.control.kind == "own" and gait is Robot.gait and robot.channels["ctrl"].shape[0]:
        yield (
            "nothing drives the robot: it has no gait of its own (Robot.gait), so its inputs stay "
            'as they are at the start; name your controller as control.kind = "module:Class", or '
            'give inputs in [control.parameters.inputs] with control.kind = "periodic"'
        )
