"""Courses for any robot: files with all lengths in bores of the robot, and missions in networks."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field, model_validator

from omnitrack_sim.base.errors import InputError, ScenarioError
from omnitrack_sim.base.paths import value_at
from omnitrack_sim.base.reading import COURSE, NAME_PATTERN, checked, read_file
from omnitrack_sim.base.table import Angle, NotNegative, Positive, Table, symbol_of
from omnitrack_sim.pipes.fittings.kinds import fitting_class, table_of
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.pipes.relief import relief_kind
from omnitrack_sim.record.metrics import Metric, Run
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.size import GRAVITY, REFERENCE_BORE
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.scenario.tables import Pipe
from omnitrack_sim.trials.axes import Axis, DirectionAxis, ListAxis, UniformAxis
from omnitrack_sim.trials.entries import Changes, robot_of
from omnitrack_sim.trials.sweep import Sweep

LADDER = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Frictions of the walls: oily steel to dry rubber."""
BATCH = 16
"""Trials that run together."""
BEHIND = 0.25
"""Room between the end of the first pipe and the robot's tail, bores: as much as the shortest
courses leave before its nose."""
ROOM = 0.5
"""Least length of the straights of a network beyond that of the robot, bores."""
MAX_SIZES = 100
"""Sizes of a course."""
FITTED = ("pipes", "network", "mission", "start")
"""Tables of a scenario whose faults say that a robot does not fit a course."""


class NetworkDraw(Table):
    """A random network of a course; fields as arguments of ``random_network``, in bores."""

    fittings: Annotated[int, Field(ge=1, le=1000)]
    lengths: tuple[float, float]
    mean_radii: tuple[float, ...]
    tee_share: Annotated[float, Field(ge=0, le=1)]


class CourseFile(Table):
    """A course as it is written, or a ladder of them. docs/studies/benchmark.md explains the keys.

    Attributes:
        sizes: of what stands in the way, such as a step, ascending: each makes a course.
        grows: dotted paths to lengths and ratios in ``pipes``, and by how much each of them changes
            with the size; what is left out there is 0 at size 0.
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    words: str
    climb_deg: Angle | None = None
    pull_rate: NotNegative = 0.0
    pipes: tuple[dict[str, Any], ...] = ()
    network: NetworkDraw | None = None
    sizes: Annotated[tuple[Positive, ...], Field(max_length=MAX_SIZES)] = ()
    grows: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _has_what_grows(self) -> CourseFile:
        if bool(self.sizes) != bool(self.grows):
            raise ValueError("needs both sizes and grows, or neither")
        if any(low >= high for low, high in pairwise(self.sizes)):
            raise ValueError("must have sizes that ascend")
        for path in self.grows:
            table, _, key = path.rpartition(".")
            place = value_at({"pipes": list(self.pipes)}, table)
            if not isinstance(place, dict) or not isinstance(place.get(key, 0.0), (int, float)):
                raise ValueError(f"has no number at {path!r}, which is to grow")
        return self

    def of_size(self, size: float) -> CourseFile:
        """Return the course of one of its sizes, with the size behind its name and words."""
        data = {"pipes": copy.deepcopy(list(self.pipes))}
        for path, rate in self.grows.items():
            table, _, key = path.rpartition(".")
            place = value_at(data, table)
            place[key] = place.get(key, 0.0) + rate * size
        made = {"name": f"{self.name}_{size:g}", "words": f"{self.words}, {size:g}"}
        pipes = tuple(data["pipes"])
        return self.model_copy(update=made | {"pipes": pipes, "sizes": (), "grows": {}})

    def scenario(self, changes: Changes, network: int = 0) -> Scenario:
        """Return the course for a robot.

        Args:
            changes: that make the entry, by dotted path.
            network: seed of the random network, where the course is in one.

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
            data |= _mission(self.network, robot, network)
        else:
            data |= _laid(_pipes(self.pipes, robot), robot)
        if self.pull_rate:
            data["pull"] = {"rate": self.pull_rate * robot.mass * GRAVITY}
        if self.climb_deg is not None:
            climb = math.radians(self.climb_deg)
            data["start"]["axis"] = [math.cos(climb), 0.0, math.sin(climb)]
        return validate(data, changes=changes)

    def sweep(self, seed: int, trials: int, changes: Changes) -> Sweep | str:
        """Return the trials of a robot on this course, or why it does not fit.

        Args:
            seed: of the draws, or of the first random network.
            trials: their number.
            changes: that make the entry, by dotted path.
        """
        # So many rungs of the ladder as there are trials, evenly spread.
        rungs = min(trials, len(LADDER))
        friction = tuple(LADDER[int((i + 0.5) * len(LADDER) / rungs)] for i in range(rungs))
        try:
            if self.network is not None:
                bases = {
                    f"network_{i}": self.scenario(
                        {**changes, "world.friction": friction[i % rungs]}, seed + i
                    )
                    for i in range(trials)
                }
                return Sweep(name=self.name, batch=BATCH, bases=bases, set=dict(changes))
            scenario = self.scenario(changes)
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
    """Keys of a fitting with its lengths, and those of its relief, times ``factor``."""
    scaled = _with_lengths(fitting_class(str(fitting["kind"])).Table, fitting, factor)
    if relief := fitting.get("relief"):
        scaled["relief"] = [
            _with_lengths(relief_kind(str(one.get("kind"))), one, factor) for one in relief
        ]
    return scaled


def _with_lengths(table: type[BaseModel], data: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Keys of a table with its lengths times ``factor``."""
    lengths = [key for key in table.model_fields if symbol_of(table, key) == "m"]
    return {
        key: value * factor if key in lengths and value is not None else value
        for key, value in data.items()
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
    draw_of_mission = np.random.default_rng([seed, 1])
    data = network.model_dump(mode="json")
    factor = robot.nominal_bore / REFERENCE_BORE
    data["fittings"] = [_scaled(fitting, factor) for fitting in data["fittings"]]
    return {"network": data, **_ends_and_gravity(network, draw_of_mission)}


def mission_sweep(
    name: str, seed: int, friction: tuple[float, float], trials: int, changes: Changes
) -> Sweep:
    """Return missions between two ends of random networks, one a trial, each a base of its own.

    Args:
        name: of the sweep.
        seed: of the first network.
        friction: range of the walls'.
        trials: their number.
        changes: of all scenarios, by dotted path.
    """
    bases = {f"network_{i}": _drawn(seed + i, friction, changes) for i in range(trials)}
    return Sweep(name=name, batch=BATCH, bases=bases, set=dict(changes))


def _drawn(seed: int, friction: tuple[float, float], changes: Changes) -> Scenario:
    network = random_network(seed)
    # A generator apart from that of the network, whose draws may become more in a later version.
    draw = np.random.default_rng([seed, 1])
    data = {
        "name": f"network_{seed}",
        "network": network.model_dump(mode="json"),
        **_ends_and_gravity(network, draw),
        "start": {"theta5_deg": float(draw.uniform(-180, 180))},
    }
    data["world"]["friction"] = float(draw.uniform(*friction))
    return validate(data, changes=changes)


def _ends_and_gravity(network: Network, draw: np.random.Generator) -> dict[str, Any]:
    """Keys of a scenario: a mission between two ends of a network, and gravity in any direction."""
    start, goal = draw.choice(network.open_ends, 2, replace=False)
    # Normal components have no preferred direction; normalised they are uniform on the sphere.
    gravity = draw.normal(size=3)
    return {
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


def _contact_force(run: Run) -> float:
    # Bodies of other robots, modules of the package's own.
    name = "wall_force" if "wall_force" in run.trajectory else "normal_force"
    # The first sample is of the seat, in which the chassis is held where a nominal bore has it.
    return float(np.fmax.reduce(run.trajectory[name][1:], axis=None, initial=0.0))


CONTACT_FORCE = Metric(
    "contact_force_max_n",
    "N",
    "largest force between the wall and one body or module of the robot",
    _contact_force,
)
