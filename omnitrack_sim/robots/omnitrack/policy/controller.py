"""Conversion of decisions to commands, and the controller that runs a policy.

A policy in a run and a learner in an environment share the conversion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationInfo, field_validator

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import FileName, Table
from omnitrack_sim.robots.control import ControlSetup, Observation, controller_of, parameters_model
from omnitrack_sim.robots.feature import (
    Feature,
    FloatRows,
    entries_of,
    held_actions,
    steps_of_decision,
)
from omnitrack_sim.robots.omnitrack.channels import MODULES
from omnitrack_sim.robots.omnitrack.control.alignment import AlignmentTable, held_belt_sign
from omnitrack_sim.robots.omnitrack.control.command import SWAPPED, Command
from omnitrack_sim.robots.omnitrack.control.jacobian import LegWatch
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.omnitrack.parameters import Omnitrack
from omnitrack_sim.robots.omnitrack.policy.features import (
    ACTIONS,
    PREVIEW,
    TRUTH,
    ModuleInput,
    features_of,
)
from omnitrack_sim.robots.omnitrack.policy.file import (
    ACTINGS,
    DIRECT,
    Acting,
    Policy,
    load_policy,
)
from omnitrack_sim.robots.omnitrack.policy.sectors import SECTOR, counted_from, modules_from

# Decisions turn the belts against each other, which reads as slip, and pass where the base alone
# slides past: with its laws for that 189 of 200 slippery turns pass, without 195.
BASE_PARAMETERS: Mapping[str, Mapping[str, Any]] = {
    "jacobian": {"sway": {"begin_again": 1e6}, "tracking": {"slip_lead": 0.0}}
}
"""Parameters of a base to which decisions are added, where they are not its defaults."""


class Decisions:
    """Decisions of n robots, and the commands that follow from them.

    ::

        decisions = Decisions(setup, features)
        while ...:
            if decisions.due.any():
                decisions.decide(policy(decisions.observe(observation)))
            command = decisions.command(observation)  # of one control period

    Robots may be reset at different times; each has its own clock.

    The robot is the same turned by 120 degrees. So modules are counted from the one that is next to
    the turning direction as a fitting comes up: theta5 is within 60 degrees then, and what is
    learned in that sector holds in all three.

    Args:
        setup: of the controller.
        features: in the order of the observation's entries.
        acting: conversion of decisions to commands.

    Raises:
        InputError: a decision period is not a whole number of control periods.

    Attributes:
        actings: ways to act by name.
        of_truth: features that the robot's own sensors do not give.
        measured: see ``InputDecisions``.
        ranges: values that each episode draws evenly, with their ranges, by dotted path.
        hold: control steps of a decision period.
        action: (n, 4), the last decision, in the robot's own order of modules; 0 before the first
            one.
        roll: (n, 3) rad, set point of the rotary motors.
        phases: names that ``Command.phase`` indexes.
    """

    actings: ClassVar[Mapping[str, Acting]] = ACTINGS
    of_truth: ClassVar[tuple[Feature, ...]] = tuple(f for f in TRUTH if f not in PREVIEW)
    measured: ClassVar[bool] = True
    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {
        "world.friction": (0.6, 1.0),
        "robot.preload": (20.0, 30.0),
        "start.theta5_deg": (-180.0, 180.0),
        "control.cruise_speed": (0.08, 0.12),
    }

    def __init__(
        self, setup: ControlSetup, features: Sequence[Feature], acting: Acting = DIRECT
    ) -> None:
        self.features, self.acting = tuple(features), acting
        self.hold = steps_of_decision(setup.period)
        n = setup.n
        self.action = np.zeros((n, len(ACTIONS)))
        self.roll, self._forward = np.zeros((2, n, 3))
        self._offset = np.zeros(n)  # rad, of the roll from that of the base
        self._tick = np.zeros(n, int)
        self._legs = LegWatch(setup)
        self._first, self._passage = np.zeros((2, n), int)
        self._band = AlignmentTable().no_motion_band
        self._base: Any = None  # a shipped controller, with ``reset``
        self.phases: tuple[str, ...] = ("decide",)
        if acting.base is not None:
            base: Any = controller_of(acting.base, Omnitrack.controllers())
            parameters = BASE_PARAMETERS.get(acting.base, {})
            self._defaults = [parameters_model(base)(**parameters)] * n
            self._base = base(replace(setup, parameters=self._defaults))
            self.phases = base.phases
        self.reset(np.arange(n), setup)

    @classmethod
    def actions_of(cls, robot: Any) -> tuple[str, ...]:  # noqa: ARG003 - protocol
        """Return the names of the entries of an action."""
        return ACTIONS

    @classmethod
    def features_of(cls, robot: Any, names: str | Sequence[str] | None) -> tuple[Feature, ...]:  # noqa: ARG003 - protocol
        """Return features by names, as ``select_features`` does; None: the set ``onboard``."""
        return features_of("onboard" if names is None else names, "observation")

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self.setup = setup
        self.action[rows], self.roll[rows] = 0.0, setup.command.roll[rows]
        self._forward[rows] = belt_sign(setup.command.roll[rows])
        self._offset[rows], self._tick[rows] = 0.0, 0
        self._first[rows], self._passage[rows] = 0, -1
        self._legs.reset(rows, setup)
        if self._base is not None:
            self._base.reset(rows, replace(setup, parameters=self._defaults))

    @property
    def due(self) -> NDArray[np.bool_]:
        """Robots (n,) whose decision period is over."""
        return self._tick % self.hold == 0

    def observe(self, observation: Observation) -> FloatRows:
        """The entries (n, k) of all features.

        Raises:
            InputError: a feature needs what these robots do not observe.
        """
        self._follow_legs(observation)
        self._choose_first_modules(observation)
        first = self._first
        action = np.hstack([modules_from(self.action[:, :3], first), self.action[:, 3:]])
        roll, seen = modules_from(self.roll, first), counted_from(observation, first)
        return entries_of(self.features, ModuleInput(self.setup, seen, action, roll))

    def _choose_first_modules(self, observation: Observation) -> None:
        """Count the modules from the one next to the turning direction, anew at each fitting."""
        location = observation.location
        first = np.round(-location.theta5 / SECTOR).astype(int) % MODULES
        self._first = np.where(location.passage != self._passage, first, self._first)
        self._passage = location.passage.copy()

    def decide(self, action: ArrayLike) -> None:
        """Set the actions (n, 4) of the robots that are ``due``, cut off at -1 and 1.

        Their modules are in the order of the last observation.

        Raises:
            ValueError: another shape, or a number that is none.
        """
        cut = held_actions(action, self.action)
        cut = np.hstack([modules_from(cut[:, :3], -self._first), cut[:, 3:]])
        self.action = np.where(self.due[:, None], cut, self.action)

    def command(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        self._follow_legs(observation)
        self._tick += 1
        setup, limit = self.setup, self.setup.settings.speed_limit[:, None]
        self._forward = held_belt_sign(observation.roll, self._band, self._forward)
        speed = self.action[:, :3] * limit * self._forward
        turned = self.action[:, 3] * setup.robot.roll_rate * setup.period  # (n,) rad
        if self._base is None:
            self.roll = self.roll + turned[:, None]
            nobody = np.zeros(setup.n, bool)
            return Command(speed, self.roll.copy(), np.zeros(setup.n, int), nobody)
        base = self._base.step(observation)
        rests = np.zeros(setup.n, bool) if base.resting is None else base.resting
        self._lean(turned, rests)
        # A base that stands to roll or backs off follows a plan, which no decision may disturb.
        speed = np.where(rests[:, None], base.belt_speed, base.belt_speed + speed)
        speed = np.minimum(np.maximum(speed, -limit), limit)
        roll = setup.command.roll if base.roll is None else base.roll
        self.roll = roll + self._offset[:, None]
        return base._replace(belt_speed=speed, roll=self.roll.copy())

    def _lean(self, turned: Array, rests: NDArray[np.bool_]) -> None:
        """Move the roll beside the base's by ``turned`` (n,) rad, and back where the base rests."""
        reach = self.acting.roll_reach
        step = self.setup.robot.roll_rate * self.setup.period
        back = -np.minimum(np.maximum(self._offset, -step), step)
        offset = self._offset + np.where(rests, back, turned)
        self._offset = np.minimum(np.maximum(offset, -reach), reach)

    def _follow_legs(self, observation: Observation) -> None:
        """Mirror the state of robots that have been sent on in the other gear."""
        changes = list(self._legs.changes(observation))
        self._passage[[robot for robot, _ in changes]] = -1
        robots = [robot for robot, turned in changes if turned]
        if not robots:
            return
        turned = np.zeros(self.setup.n, bool)
        turned[robots] = True
        each = turned[:, None]
        self.roll = np.where(each, -self.roll[:, SWAPPED], self.roll)
        self._forward = np.where(each, self._forward[:, SWAPPED], self._forward)
        # Backward as before is forward now.
        mirrored = -self.action[:, [*SWAPPED, 3]]
        self.action = np.where(each, mirrored, self.action)
        self._offset = np.where(turned, -self._offset, self._offset)


class PolicyTable(Table):
    """``[control.parameters]`` of the controller ``policy``."""

    policy: Annotated[str, Field(max_length=4096), FileName("sha256")]
    """A shipped policy by name, a policy file, relative to the scenario, or ``module:Object``."""
    sha256: Annotated[str | None, Field(validate_default=True)] = None
    """Of that file. Left out, it is filled in; another file than it says is refused, so that a
    saved run repeats itself or says why not."""

    @field_validator("policy")
    @classmethod
    def _can_be_read(cls, policy: str) -> str:
        try:
            load_policy(policy)
        except InputError as error:
            raise ValueError("; ".join(map(str, error.faults))) from None
        return policy

    @field_validator("sha256")
    @classmethod
    def _is_that_file(cls, sha256: str | None, info: ValidationInfo) -> str | None:
        if "policy" not in info.data:
            return sha256  # reported at the file's own key
        digest = load_policy(info.data["policy"]).sha256 or None
        if sha256 not in (None, digest):
            raise ValueError(f"the file has changed: it has {digest}")
        return digest


class PolicyController:
    """Evaluates the policy of each robot every decision period and carries out its decisions."""

    Parameters: ClassVar[type[Table]] = PolicyTable

    def __init__(self, setup: ControlSetup) -> None:
        names = [table.policy for table in setup.parameters]
        self._parts: list[tuple[np.ndarray, Policy, Decisions]] = []
        self._first: list[int] = []
        self.phases: tuple[str, ...] = ()
        for name in dict.fromkeys(names):
            policy = load_policy(name)
            decisions = Decisions(setup, policy.inputs, policy.acting)
            own = np.array([other == name for other in names])
            self._parts.append((own, policy, decisions))
            self._first.append(len(self.phases))
            self.phases += decisions.phases

    def step(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        commands = []
        for (own, policy, decisions), first in zip(self._parts, self._first, strict=True):
            if decisions.due.any():
                decisions.decide(policy(decisions.observe(observation)))
            command = decisions.command(observation)
            assert command.phase is not None
            commands.append((own, command._replace(phase=command.phase + first)))
        return joined(commands)


def joined(parts: Sequence[tuple[NDArray[np.bool_], Command]]) -> Command:
    """Join commands, each for its own robots (n,); all give speed, roll, phase and resting."""
    whole: dict[str, Any] = {}
    for own, command in parts:
        for name in ("belt_speed", "roll", "phase", "resting"):
            values: Any = getattr(command, name)
            rows = own.reshape(-1, *[1] * (values.ndim - 1))
            whole[name] = np.where(rows, values, whole.get(name, values))
    events = [event for own, command in parts for event in command.events if own[event.robot]]
    return Command(**whole, events=events)
