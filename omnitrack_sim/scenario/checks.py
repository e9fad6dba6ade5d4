"""What the tables of a scenario cannot see alone: geometry, start and goal, arms that fit."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from omnitrack_sim.base.bounds import too_long
from omnitrack_sim.base.errors import Fault, GeometryError, InputError, NetworkError
from omnitrack_sim.base.shipped import shipped_networks
from omnitrack_sim.pipes.layout import End
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.scenario.tables import StartTable, is_multiple
from omnitrack_sim.scenario.work import too_much_work
from omnitrack_sim.senses.cameras import camera_of

if TYPE_CHECKING:
    from omnitrack_sim.scenario.model import Scenario

ROUNDING = 1e-6
"""Part of a number of periods that may come from rounding."""


def faults_of(scenario: Scenario) -> list[Fault]:
    """Every fault of a scenario whose tables are right, one by one."""
    faults = [
        *_missing(scenario),
        *_impossible_pipes(scenario),
        *_no_such_drive(scenario),
        *_uneven_samples(scenario),
        *_impossible_cameras(scenario),
        *_no_cameras(scenario),
    ]
    if not faults and scenario.pipes:
        lengths = (pipe.step(i).fitting.length_of_axes for i, pipe in enumerate(scenario.pipes))
        faults += too_long(sum(lengths), "pipes")
    if faults:
        return faults
    try:
        line, planner = scenario.route, scenario.planner
        ways = () if planner is None else [leg.way for leg in planner.plan()]
    except GeometryError as error:
        return list(error.faults)
    except NetworkError as error:
        return [fault.at(f"mission.{fault.where}") for fault in error.faults]
    ports = {(p.index, port): None for p in line.fittings for port in (p.enter, p.leave)}
    ports |= {(i, port): None for way in ways for i, *both in way for port in both}
    if scenario.exploration is not None:  # it may come into any of them
        ports |= {
            (i, port): None
            for i, part in enumerate(line.network.parts)
            for port in part.fitting.port_names
        }
    return [
        *_taken_names(scenario),
        *_bores_out_of_reach(scenario, ports),
        *_misplaced(scenario),
        *too_much_work(scenario),
    ]


def _taken_names(scenario: Scenario) -> list[Fault]:
    """Names of pipes that an earlier pipe has."""
    names = [part.name for part in scenario.route.network.parts] if scenario.pipes else []
    first: dict[str, int] = {}
    return [
        Fault(f"pipes.{i}.name", f"{name!r} is taken by an earlier pipe")
        for i, name in enumerate(names)
        if first.setdefault(name, i) != i
    ]


def _missing(scenario: Scenario) -> list[Fault]:
    """Pipes and mission: one of them, and what goes with it."""
    if scenario.network is None and scenario.mission is None:
        return (
            []
            if scenario.pipes
            else [Fault("pipes", "is missing: a list of pipes, or give network and mission")]
        )
    faults = []
    if scenario.pipes:
        faults.append(Fault("pipes", "are given as well as a network; give one of them"))
    if scenario.network is None:
        faults.append(
            Fault(
                "network",
                "is missing: a file, a shipped network or a table",
                tuple(shipped_networks()),
            )
        )
    if scenario.mission is None:
        faults.append(Fault("mission", "is missing: a table with start and goals"))
    for key, default in (("axis", StartTable().axis), ("turn_deg", StartTable().turn_deg)):
        if getattr(scenario.start, key) != default:
            faults.append(Fault(f"start.{key}", "is for pipes; a network has its own place"))
    if scenario.run.goal_distance is not None:
        faults.append(Fault("run.goal_distance", "is for pipes; a mission has goals"))
    return faults


def _no_such_drive(scenario: Scenario) -> list[Fault]:
    """A drive that there is not."""
    try:
        drive_of(scenario.robot.drive)
    except InputError as error:
        return list(error.faults)
    return []


def _uneven_samples(scenario: Scenario) -> list[Fault]:
    """A record period that is no whole number of control periods."""
    period, step = scenario.record.period, scenario.physics.control_period
    if is_multiple(period, step):
        return []
    problem = f"is {period} s, not a whole multiple of physics.control_period ({step} s)"
    return [Fault("record.period", problem)]


def _impossible_cameras(scenario: Scenario) -> list[Fault]:
    """A camera that there is not, or whose pictures fall between two control steps."""
    table, period = scenario.sensing, scenario.physics.control_period
    if table.kind != "onboard":
        return []
    try:
        optics = camera_of(table).optics
    except InputError as error:
        return list(error.faults)
    faults, where = [], f"sensing.{table.camera}"
    for key, steps in (("rate", 1 / (optics.rate * period)), ("latency", optics.latency / period)):
        if abs(steps - round(steps)) > ROUNDING * max(1.0, steps) or (key == "rate" and steps < 1):
            told = f"is {getattr(optics, key):g}; it has to be a whole number of control periods"
            rates = [f"{1 / (n * period):g}" for n in (1, 2, 4, 5, 10, 20)]
            choices = tuple(rates) if key == "rate" else ()
            problem = f"{told} (physics.control_period, {period:g} s)"
            faults.append(Fault(f"{where}.{key}", problem, choices))
    return faults


def _no_cameras(scenario: Scenario) -> list[Fault]:
    """Pictures asked for of a robot without cameras."""
    if not scenario.record.pictures or scenario.sensing.kind == "onboard":
        return []
    problem = 'is true, for which the robot needs cameras: sensing.kind = "onboard"'
    return [Fault("record.pictures", problem)]


def _impossible_pipes(scenario: Scenario) -> list[Fault]:
    """Pipes whose sizes do not go together."""
    faults = []
    for i, pipe in enumerate(scenario.pipes):
        try:
            pipe.step(i)
        except GeometryError as error:
            faults += [f.at(f"pipes.{i}.{f.where.rpartition('.')[2]}") for f in error.faults]
    return faults


def _bores_out_of_reach(scenario: Scenario, ports: Iterable[End]) -> list[Fault]:
    """The first bore, at the ports that are passed, that the arms do not reach."""
    robot = scenario.robot
    low, high = (robot.nominal_pipe_radius + travel for travel in robot.slide_range)
    where = "pipes" if scenario.pipes else "network.fittings"
    for index, port in ports:
        fitting = scenario.route.network.parts[index].fitting
        radius = fitting.port_radius(port)
        if not low < radius < high:
            key = f"{where}.{index}.{fitting.bore_key(port)}"
            problem = (
                f"is {2 * radius:.4g} m; the arms reach bores from {2 * low:.4g} to "
                f"{2 * high:.4g} m (robot.scale makes the robot for other bores)"
            )
            return [Fault(key, problem)]
    return []


def _misplaced(scenario: Scenario) -> list[Fault]:
    """A start or goal that is not on the route."""
    half, length = scenario.robot.length / 2, scenario.route.centreline.length
    distance, goal = scenario.start.distance, scenario.run.goal_distance
    if not half <= distance <= length - half:
        problem = (
            f"is {distance} m; the robot lies inside the pipe from {half:.4f} to "
            f"{length - half:.4f} m"
        )
        return [Fault("start.distance", problem)]
    if goal is not None and not distance < goal <= length:
        problem = f"is {goal} m; must be over start.distance and at most {length:.4f} m"
        return [Fault("run.goal_distance", problem)]
    return []
