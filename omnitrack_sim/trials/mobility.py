"""Suite ``mobility``: any robot through the same courses, at every friction of a ladder.

Courses are files of ``scenarios/courses``, with all lengths in bores of the robot. Version, courses
and seeds belong together: whoever changes a course or a seed gives the suite another version.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from omnitrack_sim.base.errors import Fault, InputError, ScenarioError
from omnitrack_sim.base.naming import shipped_files
from omnitrack_sim.base.reading import COURSE, NAME_PATTERN, checked, read_file
from omnitrack_sim.base.table import Angle, NotNegative, Table, symbol_of
from omnitrack_sim.pipes.fittings.kinds import fitting_class, table_of
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.record.metrics import Metric, Run
from omnitrack_sim.robots.control import controller_of
from omnitrack_sim.robots.kinds import DEFAULT, ROBOTS, robot_class
from omnitrack_sim.robots.plant import is_similar
from omnitrack_sim.robots.robot import GRAVITY, Robot
from omnitrack_sim.robots.size import REFERENCE_BORE
from omnitrack_sim.scenario import Scenario, set_value, validate
from omnitrack_sim.scenario.tables import Pipe
from omnitrack_sim.trials.axes import Axis, DirectionAxis, ListAxis, UniformAxis
from omnitrack_sim.trials.bench import BenchMeasure, Changes, Course, Entry, Suite
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.table import numbers_of, passed_of

VERSION = 2
SEED = 72_000
"""Seed of the first course; the others follow it."""
FIRST_NETWORK = 72_000_000
"""Seed of the first random network."""
LADDER = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Frictions of the walls: oily steel to dry rubber."""
TRIALS, QUICK = 40, 2
"""Trials of a robot on a course: five at each friction; with ``--quick`` at 0.5 and 0.9."""
NETWORKS, QUICK_NETWORKS = 10, 1
"""The same in random networks, which take as long as all other courses together."""
BATCH = 16
"""Trials that run together."""
BEHIND = 0.25
"""Room between the end of the first pipe and the robot's tail, bores."""
ROOM = 0.5
"""Least length of the straights of a network beyond that of the robot, bores."""
FITTED = ("pipes", "network", "mission", "start")
"""Tables of a scenario whose faults say that a robot does not fit a course."""
ORDER = (
    "straight_level",
    "straight_up_45",
    "straight_up_90",
    "straight_down_45",
    "straight_down_90",
    "elbow_30",
    "elbow_15",
    "elbow_10",
    "elbow_06",
    "two_elbows",
    "tee_over",
    "tee_into",
    "tee_out",
    "wye_into",
    "reducer",
    "bore_small",
    "bore_large",
    "network",
    "pull",
)
"""Courses of this version."""


class NetworkDraw(Table):
    """A random network of a course; fields as arguments of ``random_network``, in bores."""

    fittings: Annotated[int, Field(ge=1, le=1000)]
    lengths: tuple[float, float]
    mean_radii: tuple[float, ...]
    tee_share: Annotated[float, Field(ge=0, le=1)] = 0.5


class CourseFile(Table):
    """A course as it is written. docs/studies/benchmark.md explains the keys."""

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    words: str
    climb_deg: Angle | None = None
    pull_rate: NotNegative = 0.0
    pipes: tuple[dict[str, Any], ...] = ()
    network: NetworkDraw | None = None

    def scenario(self, number: int, changes: Changes) -> Scenario:
        """Return the course for a robot.

        Args:
            number: of the trial, which decides the random network.
            changes: that make the entry, by dotted path.

        Raises:
            ScenarioError: the robot does not fit.
        """
        robot = robot_of(changes)
        data: dict[str, Any] = {
            "name": self.name,
            "start": {"distance": robot.length / 2 + BEHIND * robot.nominal_bore},
            "control": {"cruise_speed": robot.nominal_speed},
            "record": {"metrics": [f"{__name__}:CONTACT_FORCE"]},
        }
        if self.network is not None:
            data |= _mission(self.network, robot, FIRST_NETWORK + number)
        else:
            data |= _laid(_pipes(self.pipes, robot), robot)
        if self.pull_rate:
            data["pull"] = {"rate": self.pull_rate * robot.mass * GRAVITY}
        if self.climb_deg is not None:
            climb = math.radians(self.climb_deg)
            data["start"]["axis"] = [math.cos(climb), 0.0, math.sin(climb)]
        return validate(data, changes=changes)

    def sweep(self, seed: int, trials: int, changes: Changes) -> Sweep | str:
        """Return the trials of a robot on this course, or why it does not fit."""
        # So many rungs of the ladder as there are trials, evenly spread.
        rungs = min(trials, len(LADDER))
        friction = tuple(LADDER[int((i + 0.5) * len(LADDER) / rungs)] for i in range(rungs))
        try:
            if self.network is not None:
                bases = {
                    f"network_{i}": self.scenario(
                        i, {**changes, "world.friction": friction[i % rungs]}
                    )
                    for i in range(trials)
                }
                return Sweep(name=self.name, batch=BATCH, bases=bases, set=dict(changes))
            scenario = self.scenario(0, changes)
        except ScenarioError as error:
            # Only what the pipes refuse is a misfit; a wrong change is the user's mistake.
            if any(fault.where.partition(".")[0] not in FITTED for fault in error.faults):
                raise
            return "; ".join(str(error).splitlines())
        axes: list[Axis] = [
            ListAxis(path="world.friction", kind="list", values=friction),
            UniformAxis(path="start.theta5_deg", kind="uniform", low=-180, high=180),
        ]
        if self.climb_deg is None:
            axes.append(DirectionAxis(path="world.gravity", kind="direction", magnitude=GRAVITY))
        return Sweep(
            name=self.name,
            seed=seed,
            samples=math.ceil(trials / rungs),
            sampling="latin_hypercube",
            draws="independent",
            batch=BATCH,
            axes=tuple(axes),
            bases={self.name: scenario},
            set=dict(changes),
        )


def _scaled(fitting: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Keys of a fitting with its lengths times ``factor``."""
    table = fitting_class(str(fitting["kind"])).Table
    lengths = [key for key in table.model_fields if symbol_of(table, key) == "m"]
    return {
        key: value * factor if key in lengths and value is not None else value
        for key, value in fitting.items()
    }


def _pipes(pipes: tuple[dict[str, Any], ...], robot: Robot) -> list[dict[str, Any]]:
    """Pipes of a course in metres, with room for the robot in the first and the last one."""
    scaled = [_scaled({"inner_diameter": 1.0, **pipe}, robot.nominal_bore) for pipe in pipes]
    for pipe in (scaled[0], scaled[-1]):
        pipe["length"] += robot.length
    return scaled


def _laid(pipes: list[dict[str, Any]], robot: Robot) -> dict[str, Any]:
    """Keys of a scenario with these pipes one after another.

    A port beside the way, of a tee or a wye, leads into a straight that holds the robot: beyond an
    open end a limb would meet the pipes from outside, as no robot in a main can.
    """
    ways = [table_of(pipe["kind"], Pipe).model_validate(pipe) for pipe in pipes]
    beside = [
        (i, port)
        for i, pipe in enumerate(ways)
        for port in pipe.fitting().ports
        if port not in (pipe.enter, pipe.leave)
    ]
    if not beside:
        return {"pipes": pipes}
    own = ("enter", "leave", "turn_deg")
    fittings = [
        {key: value for key, value in {"name": f"pipe_{i}", **pipe}.items() if key not in own}
        for i, pipe in enumerate(pipes)
    ]
    joints = [
        {
            "ports": (f"pipe_{i}.{a.leave}", f"pipe_{i + 1}.{b.enter}"),
            "turn_deg": b.turn_deg,
        }
        for i, (a, b) in enumerate(pairwise(ways))
    ]
    for i, port in beside:
        bore = 2 * ways[i].fitting().port_radius(port)
        length = robot.length + robot.nominal_bore
        name = f"beside_{i}_{port}"
        straight = {"kind": "straight", "name": name, "inner_diameter": bore, "length": length}
        fittings.append(straight)
        joints.append({"ports": (f"pipe_{i}.{port}", f"{name}.start")})
    return {
        "network": {"fittings": fittings, "joints": joints},
        "mission": {"start": "pipe_0.start", "goals": [f"pipe_{len(pipes) - 1}.end"]},
    }


def _mission(draw: NetworkDraw, robot: Robot, seed: int) -> dict[str, Any]:
    """Keys of a scenario: a random network and the way between two of its ends."""
    low, high = draw.lengths
    low = max(low, robot.length / robot.nominal_bore + ROOM)
    network = random_network(
        seed,
        draw.fittings,
        lengths=(low * REFERENCE_BORE, max(low, high) * REFERENCE_BORE),
        mean_radii=tuple(radius * REFERENCE_BORE for radius in draw.mean_radii),
        tee_share=draw.tee_share,
        inner_diameter=REFERENCE_BORE,
    )
    # A generator apart from that of the network, whose draws may become more in a later version.
    generator = np.random.default_rng([seed, 1])
    start, goal = generator.choice(network.open_ends, 2, replace=False)
    gravity = generator.normal(size=3)
    data = network.model_dump(mode="json")
    factor = robot.nominal_bore / REFERENCE_BORE
    data["fittings"] = [_scaled(fitting, factor) for fitting in data["fittings"]]
    return {
        "network": data,
        "mission": {"start": str(start), "goals": [str(goal)]},
        "world": {"gravity": (GRAVITY * gravity / np.linalg.norm(gravity)).tolist()},
    }


def load_course(source: str | Path) -> CourseFile:
    """Read a course file, or a shipped course by name.

    Raises:
        InputError: no such file, bad TOML, or any fault in it.
    """
    _, data = read_file(source, COURSE, InputError)
    return checked(CourseFile, data, InputError)


def robot_of(changes: Changes) -> Robot:
    """Return the robot of an entry.

    Raises:
        InputError: there is no such robot, or one of its values does not fit.
    """
    data: dict[str, Any] = {"robot": {}}
    for path, value in changes.items():
        if path.startswith("robot."):
            set_value(data, path, value)
    kind = data["robot"].pop("kind", DEFAULT)
    return checked(robot_class(kind), data["robot"], InputError)


# Entries

_VARIANTS = (
    Entry(
        "differential",
        "the omnidirectional robot with one motor and a differential",
        {"robot.drive": "differential"},
    ),
    Entry(
        "onboard",
        "the omnidirectional robot by its own sensors, on a map that it is given",
        {"sensing.kind": "onboard"},
    ),
)


def shipped_entries() -> dict[str, Entry]:
    """Return the robots that come with the package by name, each with its own controller."""
    entries = {}
    for kind in ROBOTS:
        if kind != "mjcf":
            about = (robot_class(kind).__doc__ or kind).partition("\n\n")[0]
            words = " ".join(about.split()).rstrip(".")
            entries[kind] = Entry(kind, words, {"robot.kind": kind})
        if kind == DEFAULT:
            entries |= {entry.name: entry for entry in _VARIANTS}
    return entries


def entry_of(source: str, controller: str) -> Entry:
    """Return the entry for a robot.

    Args:
        source: name of a shipped entry, an MJCF or URDF file, or ``module:Class``; ``NAME=`` before
            it gives it another name, ``@BORE`` after it makes a similar robot for a bore of so many
            metres. None: the package's own robot.
        controller: kind of controller of that robot, or ``module:Class``; none: the robot's own.

    Raises:
        InputError: there is no such robot or controller, or it cannot be used.
    """
    name, is_renamed, what = (source or DEFAULT).rpartition("=")
    what, bore = _without_bore(what)
    shipped = shipped_entries()
    if what in shipped:
        entry = shipped[what]
    elif Path(what).suffix in (".xml", ".mjcf", ".urdf"):
        # Workers may run in another folder.
        changes = {"robot.kind": "mjcf", "robot.file": str(Path(what).resolve())}
        entry = Entry(Path(what).stem, f"robot of {what}", changes)
    else:
        robot_class(what)
        entry = Entry(what.replace(":", "."), f"robot {what}", {"robot.kind": what})
    if bore is not None:
        entry = _resized(entry, bore)
    robot = robot_of(entry.changes)
    if controller:
        controller_of(controller, robot.controllers())
        changes = {**entry.changes, "control.kind": controller}
        entry = Entry(f"{entry.name}.{controller}".replace(":", "."), entry.words, changes)
    return entry.renamed(name if is_renamed else entry.name, source)


def _without_bore(source: str) -> tuple[str, float | None]:
    """Split ``ROBOT@BORE``; a file may have an ``@`` in its name."""
    what, _, bore = source.rpartition("@")
    try:
        return (what, float(bore)) if what else (source, None)
    except ValueError:
        return source, None


def _resized(entry: Entry, bore: float) -> Entry:
    """Return the entry of a similar robot for a bore of ``bore`` m.

    Raises:
        InputError: the model has sizes that are no parameters, or there is no such bore.
    """
    robot = robot_of(entry.changes)
    if not 0 < bore < math.inf:
        raise InputError(Fault(f"entry {entry.name}", f"@{bore:g} is no bore in metres"))
    new = {f"robot.{name}": value for name, value in robot.similar_to(bore).items()}
    changes = {**entry.changes, **new}
    made = robot_of(changes)
    if not (math.isclose(made.nominal_bore, bore) and is_similar(robot, made)):
        problem = "cannot be made for another bore: it has sizes that are no parameters with units"
        raise InputError(Fault(f"entry {entry.name}", problem))
    size = f"{1000 * bore:g} mm"
    return Entry(f"{entry.name}_{size.replace(' ', '')}", f"{entry.words}, for {size}", changes)


# Scores


def _contact_force(run: Run) -> float:
    # Bodies of other robots, modules of the package's own.
    name = "wall_force" if "wall_force" in run.trajectory else "normal_force"
    # The first sample is of the seat, in which the chassis is held where a nominal bore has it.
    return float(np.nan_to_num(run.trajectory[name][1:]).max(initial=0.0))


CONTACT_FORCE = Metric(
    "contact_force_max_n",
    "N",
    "largest force between the wall and one body or module of the robot",
    _contact_force,
)


def least_friction(table: Any) -> float:
    """Return the lowest friction of the ladder at which, and at all higher ones, at least half of
    the trials passed; not a number where there is none."""
    passed = passed_of(table)
    if "world.friction" not in table.column_names:
        return math.nan
    friction, least = numbers_of(table, "world.friction"), math.nan
    # Trials in networks are not on the ladder: each has its friction in its own scenario.
    for rung in sorted({*friction[np.isfinite(friction)].tolist()}, reverse=True):
        own = passed[(friction == rung) & np.isfinite(passed)]
        if not len(own) or own.mean() < 0.5:
            break
        least = rung
    return least


def _courses() -> dict[str, Course]:
    courses = {}
    for i, name in enumerate(ORDER):
        file = load_course(shipped_files("courses")[name])
        counts = (NETWORKS, QUICK_NETWORKS) if file.network is not None else (TRIALS, QUICK)
        sweep, is_passed = partial(file.sweep, SEED + i), not file.pull_rate
        courses[name] = Course(name, file.words, *counts, sweep, is_passed)
    return courses


SUITE = Suite(
    "mobility",
    "Robots compared",
    version=VERSION,
    courses=_courses(),
    entries=shipped_entries,
    entry_of=entry_of,
    measures=(
        BenchMeasure("duration_s", "s", "time"),
        BenchMeasure("mean_speed_m_s", "m/s", "speed"),
        BenchMeasure("energy_per_metre", "J/m", "energy", "energy_j", over="distance_m"),
        BenchMeasure("contact_force_max_n", "N", "wall force"),
        BenchMeasure("pull_held_n", "N", "pull left over", of_failures=True),
        BenchMeasure("pose_error", "m", "pose error", "localisation_error_mean_m"),
    ),
    scores={"least_friction": least_friction},
)
