"""Options of ``gymnasium.make``, checked as scenarios are, and the terms of the reward."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import trusting
from omnitrack_sim.base.paths import matches
from omnitrack_sim.base.reading import checked
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import shown
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.feature import Feature
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.sim.simulation import Simulation

_DRAWN = ("world.friction", "start.theta5_deg", "control.cruise_speed", "start.distance")
"""Values that an episode may draw, beside those of the robot: robots of one batch need not share
them."""
Range = tuple[float, float]
_UNION_FIELDS = {
    "ranges": (2, "a range (least, largest), one number, or None for the scenario's own"),
    "observation": (1, "a name, or a list of names"),
}
"""Values of several types: at which level they stand, and what they may be."""


class EnvOptions(Table):
    """Options of an environment."""

    scenario: str = "tee_turn"
    """A shipped scenario, a scenario file, or "random_network": a random mission through a random
    network in each episode."""
    changes: dict[str, Any] = Field(default_factory=dict)
    """Values of the scenario by dotted path, as of `ot.override`."""
    observation: str | tuple[str, ...] | None = None
    """A set of features (`onboard`, `preview`, `truth`; other robots: `joints`, `route`), or a list
    of sets, of single features and of your own, `module:Object`. Left out: the first."""
    sensing: Literal["onboard", "truth"] | None = None
    """Source of the entries: the robot's own sensors or the truth. Left out: `truth`
    for the observation `truth` and for other robots, otherwise `onboard`."""
    picture: bool = False
    """The observation has the depth picture, too."""
    acting: str = "direct"
    """`direct`: actions are the command; `residual`: they are added to that of the feedback
    controller, which other robots have not."""
    ranges: dict[str, Range | float | None] = Field(default_factory=dict)
    """Draws of each trial, by dotted path: least and largest value, a number for one value, or
    None for that of the scenario."""
    gravity: Literal["any", "scenario"] = "any"
    """`any`: 9.81 m/s² in a random direction in each trial; `scenario`: as the scenario says."""
    fittings: Annotated[tuple[int, int], Field()] = (6, 12)
    """Of a random network: the least and largest number of its fittings."""
    reward: dict[str, float] = Field(default_factory=dict)
    """Weights of terms of the reward; those left out stay as they are."""
    threads: Annotated[int, Field(ge=0, le=1024)] = 1
    """Native threads for the physics; 0 uses all cores. The results do not depend on it."""
    render_mode: Literal["rgb_array", "human"] | None = None
    """`rgb_array`: `render` returns a picture; `human`: a window shows the robot."""
    camera: Literal["side", "follow", "onboard"] = "side"
    """Of the pictures."""
    width: Annotated[int, Field(ge=16, le=4096)] = 640
    """Of the pictures, pixels."""
    height: Annotated[int, Field(ge=16, le=4096)] = 360
    """Of the pictures, pixels."""

    def features(self, robot: Robot) -> tuple[Feature, ...]:
        """Observed features of a robot, in the order of the entries."""
        with trusting():
            return robot.decisions.features_of(robot, self.observation)

    def senses(self, robot: Robot) -> str:
        """The scenario's ``sensing.kind``."""
        # Features of the truth need it; any other set can be had from the robot's own sensors.
        onboard = _is_measured(robot) and self.observation != "truth"
        return self.sensing or ("onboard" if onboard else "truth")

    def drawn(self, robot: Robot) -> dict[str, Range]:
        """Least and largest value of what each trial of a robot draws, by dotted path."""
        ranges = {**robot.decisions.ranges, **self.ranges}
        return {
            path: value if isinstance(value, tuple) else (value, value)
            for path, value in ranges.items()
            if value is not None
        }

    @property
    def weights(self) -> dict[str, float]:
        """Weights of all terms of the reward."""
        return {term.name: self.reward.get(term.name, term.weight) for term in TERMS.values()}


def options_of(given: Mapping[str, Any]) -> EnvOptions:
    """Options from the keyword arguments of an environment.

    Raises:
        InputError: lists every fault with its place and the choices.
    """

    def fault(item: Mapping[str, Any]) -> Fault | None:
        level, right = _UNION_FIELDS.get(item["loc"][0], (0, ""))
        if not 0 < level < len(item["loc"]):
            return None
        place, value = item["loc"][:level], given
        for key in place:
            value = value[key]
        return Fault(".".join(place), f"is {shown(value)}; it must be {right}")

    options = checked(EnvOptions, given, InputError, own_fault=fault)
    faults = _unknown("reward", options.reward, tuple(TERMS))
    for path, value in options.ranges.items():
        if isinstance(value, tuple) and value[0] > value[1]:
            problem = f"is from {value[0]:g} to {value[1]:g}; the least value stands first"
            faults.append(Fault(f"ranges.{path}", problem))
    low, high = options.fittings
    if not 1 <= low <= high:
        faults.append(Fault("fittings", f"is from {low} to {high}; from 1, the least number first"))
    if faults:
        raise InputError(faults)
    return options


def check_for(options: EnvOptions, robot: Robot) -> None:
    """Refuse options that mean nothing for a robot.

    Raises:
        InputError: lists every fault with its place and the choices.
    """
    decisions, onboard = robot.decisions, options.senses(robot) == "onboard"
    data = {"robot": robot.model_dump(mode="json")}
    own = tuple(one for path in robot.own_values for one in matches(data, f"robot.{path}"))
    rolls = ("start.roll_deg",) if robot.rolls else ()
    faults = _unknown("ranges", options.ranges, (*_DRAWN, *rolls, *own))
    if options.acting not in decisions.actings:
        choices = tuple(decisions.actings)
        faults.append(Fault("acting", f"is {options.acting!r}", choices, given=options.acting))
    if onboard and not _is_measured(robot):
        problem = "is 'onboard', and no sensors of this robot give its features"
        faults.append(Fault("sensing", problem, ("truth",)))
    # Robots that observe the truth have no camera.
    if options.picture and not onboard:
        faults.append(Fault("picture", 'is there with sensing = "onboard" alone'))
    faults += _unobserved(options, robot)
    if faults:
        raise InputError(faults)


def _is_measured(robot: Robot) -> bool:
    """Return whether a robot's own sensors give its features."""
    return robot.decisions.measured and robot.odometry() is not None


def _unobserved(options: EnvOptions, robot: Robot) -> Sequence[Fault]:
    """Features that there are not, or not for these robots."""
    try:
        features = options.features(robot)
    except InputError as error:
        return error.faults
    only_true = [f.name for f in features if f in robot.decisions.of_truth]
    if options.senses(robot) == "truth" or not only_true:
        return []
    problem = f'asks for {", ".join(only_true)}, which are there with sensing = "truth" alone'
    return [Fault("observation", problem)]


def _unknown(where: str, given: Mapping[str, Any], known: tuple[str, ...]) -> list[Fault]:
    return [
        Fault(f"{where}.{key}", "unknown key", known, given=key)
        for key in given
        if key not in known
    ]


@dataclass(frozen=True)
class Term:
    """A part of the reward.

    Attributes:
        name: for options and ``info``.
        unit: of its measure, for one decision.
        weight: default factor of the measure.
        meaning: one line for the docs.
    """

    name: str
    unit: str
    weight: float
    meaning: str


# The way through a tee is about 5 D long, so that progress brings about 5, and arriving half as
# much again. The costs of a gentle drive are a tenth of that.
_TERMS = (
    Term("progress", "D", 1.0, "way along the route; backward it is negative"),
    Term("tilt", "rad s", -0.2, "robot axis against the centreline, over time"),
    Term("slip", "D", -0.2, "way of what touches the wall over it, mean of modules or bodies"),
    Term(
        "torque_change",
        "torque limits",
        -0.02,
        "change of the motors' torques from control step to control step, mean of the motors",
    ),
    Term("arrival", "1", 2.5, "1 when the robot reaches its goal"),
    Term("failure", "1", -2.5, "1 when its run ends otherwise, but for the end of its time"),
)
TERMS: Mapping[str, Term] = {term.name: term for term in _TERMS}
"""The terms of the reward by name."""


class Tally:
    """Adds up the terms of n robots over the control steps of one decision, by the truth."""

    def __init__(self, simulation: Simulation) -> None:
        n, first = simulation.n, simulation.scenarios[0]
        self._bore, self._period = first.robot.nominal_bore, simulation.period
        self.measured: dict[str, Array] = {name: np.zeros(n) for name in TERMS}
        self._limit = simulation.plant.effort_limit
        self._remember(simulation)

    def _remember(self, simulation: Simulation) -> None:
        self._active, self._leg = simulation.active, simulation.legs.number
        self._location: Location = simulation.location
        self._effort = simulation.plant.effort(simulation.readings)

    def add(self, simulation: Simulation) -> None:
        """Add the control step that has just been done."""
        measured, readings, location = self.measured, simulation.readings, simulation.location
        plant = simulation.plant
        # On another leg the way is counted from elsewhere.
        same = self._active & (simulation.legs.number == self._leg)
        moved = location.distance - self._location.distance
        measured["progress"] += np.where(same, moved / self._bore, 0.0)
        slip = plant.slip_speed(readings)
        change = (np.abs(plant.effort(readings) - self._effort) / self._limit).mean(axis=1)
        measured["tilt"] += np.where(self._active, location.tilt * self._period, 0.0)
        measured["slip"] += np.where(self._active, slip * self._period / self._bore, 0.0)
        measured["torque_change"] += np.where(self._active, change, 0.0)
        self._remember(simulation)

    def over(
        self, arrived: NDArray[np.bool_], failed: NDArray[np.bool_], diverged: NDArray[np.bool_]
    ) -> Mapping[str, Array]:
        """Return all terms (n,) of the reward at the end of the decision.

        Of robots whose physics has diverged only the failure counts.
        """
        self.measured["arrival"] += arrived
        self.measured["failure"] += failed
        for name in TERMS:
            if name != "failure":
                self.measured[name] = np.where(diverged, 0.0, self.measured[name])
        return self.measured
