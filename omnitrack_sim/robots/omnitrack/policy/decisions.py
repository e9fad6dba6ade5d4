"""From decisions to commands: the same steps for whoever decides, a policy in a run or a learner in
an environment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack.control.aligner import AlignmentTable, held_belt_sign
from omnitrack_sim.robots.omnitrack.control.gear import SWAPPED
from omnitrack_sim.robots.omnitrack.control.interface import Command, ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.omnitrack.policy.actions import ACTIONS, DECISION_PERIOD, DIRECT, Acting
from omnitrack_sim.robots.omnitrack.policy.base import Bases
from omnitrack_sim.robots.omnitrack.policy.feature import Entries, Feature, View

ROUNDING = 1e-6
"""Part of a control step by which a decision period may miss a whole number of them."""


class Decisions:
    """Decisions of n robots, and what comes of them.

    ::

        decisions = Decisions(setup, features)
        while ...:
            if decisions.due.any():
                decisions.decide(policy(decisions.observe(observation)))
            command = decisions.command(observation)  # of one control period

    A robot may begin anew at any time (``begin``); each has its own clock.

    Args:
        setup: of the controller. features: in the order of the observation's entries.
        acting: how a decision becomes a command.

    Raises:
        InputError: a decision period is not a whole number of control periods.

    Attributes:
        hold: control steps of a decision period.
        action: (n, 4) decided last; 0 before the first decision.
        roll: (n, 3) rad, asked of the rotary motors.
        phases: that ``Command.phase`` indexes.
    """

    def __init__(
        self, setup: ControlSetup, features: Sequence[Feature], acting: Acting = DIRECT
    ) -> None:
        self.setup, self.features, self.acting = setup, tuple(features), acting
        self.hold = steps_of(DECISION_PERIOD, setup.period)
        n = setup.n
        self.action = np.zeros((n, len(ACTIONS)))
        self.roll = np.array(setup.roll, float)
        self._offset, self._tick = np.zeros(n), np.zeros(n, int)
        self._band = AlignmentTable().no_motion_band
        self._forward = belt_sign(self.roll)
        self._leg, self._gear = np.full(n, -1), np.ones(n, int)
        self._bases = None if acting.base is None else Bases(setup, acting.base)
        self.phases = ("decide",) if self._bases is None else self._bases.phases

    @property
    def due(self) -> NDArray[np.bool_]:
        """Robots (n,) whose decision period is over."""
        return self._tick % self.hold == 0

    def begin(self, robots: NDArray[np.bool_], setup: ControlSetup) -> None:
        """Robots (n,) begin anew, as ``setup`` says of them; the others go on."""
        self.setup = setup
        each = robots[:, None]
        self.action = np.where(each, 0.0, self.action)
        self.roll = np.where(each, setup.roll, self.roll)
        self._forward = np.where(each, belt_sign(setup.roll), self._forward)
        self._offset = np.where(robots, 0.0, self._offset)
        self._tick, self._leg = np.where(robots, 0, self._tick), np.where(robots, -1, self._leg)
        if self._bases is not None and np.count_nonzero(robots):
            self._bases.begin(robots, setup)

    def observe(self, observation: Observation) -> Entries:
        """The entries (n, k) of all features.

        Raises:
            InputError: a feature needs what these robots do not observe.
        """
        self._follow_legs(observation)
        view = View(self.setup, observation, self.action, self.roll)
        found = []
        for feature in self.features:
            try:
                found.append(feature.entries(view))
            except AttributeError as error:
                problem = f"{feature.name!r} is not there for these robots: {error}"
                raise InputError(Fault("features", problem)) from error
        return np.concatenate(found, axis=1)

    def decide(self, action: ArrayLike) -> None:
        """Take on actions (n, 4) of the robots that are ``due``; what is beyond -1 and 1 is cut
        off.

        Raises:
            ValueError: another shape, or a number that is none.
        """
        given = np.asarray(action, np.float32)
        if given.shape != self.action.shape:
            raise ValueError(f"action has shape {given.shape}, expected {self.action.shape}")
        if not np.isfinite(given).all():
            raise ValueError("action: is not a number, or infinite")
        cut = np.minimum(np.maximum(given, -1), 1).astype(float)
        self.action = np.where(self.due[:, None], cut, self.action)

    def command(self, observation: Observation) -> Command:
        """The command for the next control period."""
        self._follow_legs(observation)
        self._tick += 1
        setup, limit = self.setup, self.setup.settings.speed_limit[:, None]
        self._forward = held_belt_sign(observation.roll, self._band, self._forward)
        speed = self.action[:, :3] * self.acting.speed * limit * self._forward
        turned = self.action[:, 3] * setup.robot.roll_rate * setup.period  # (n,) rad
        if self._bases is None:
            self.roll = self.roll + turned[:, None]
            nobody = np.zeros(setup.n, bool)
            return Command(speed, self.roll.copy(), np.zeros(setup.n, int), nobody)
        base = self._bases.step(observation)
        rests = np.zeros(setup.n, bool) if base.resting is None else base.resting
        self._lean(turned, rests)
        speed = np.where(rests[:, None], base.belt_speed, base.belt_speed + speed)
        speed = np.minimum(np.maximum(speed, -limit), limit)
        roll = setup.roll if base.roll is None else base.roll
        self.roll = roll + self._offset[:, None]
        return base._replace(belt_speed=speed, roll=self.roll.copy())

    def _lean(self, turned: Array, rests: NDArray[np.bool_]) -> None:
        """Move the roll beside the base's by ``turned`` (n,) rad, and back where the base rests."""
        reach, step = self.acting.roll_reach, self.setup.robot.roll_rate * self.setup.period
        back = -np.minimum(np.maximum(self._offset, -step), step)
        offset = self._offset + np.where(rests, back, turned)
        self._offset = np.minimum(np.maximum(offset, -reach), reach)

    def _follow_legs(self, observation: Observation) -> None:
        """Mirror what is held of robots that have been sent on in the other gear."""
        known = (self._leg >= 0) & (self._leg != observation.leg)
        turned = known & (self._gear != observation.gear)
        self._leg, self._gear = observation.leg, observation.gear
        if not np.count_nonzero(turned):
            return
        each = turned[:, None]
        self.roll = np.where(each, -self.roll[:, SWAPPED], self.roll)
        self._forward = np.where(each, self._forward[:, SWAPPED], self._forward)
        # Backward as before is forward now.
        mirrored = -self.action[:, [*SWAPPED, 3]]
        self.action = np.where(each, mirrored, self.action)
        self._offset = np.where(turned, -self._offset, self._offset)


def steps_of(decision: float, control: float) -> int:
    """Control periods of ``control`` s in a decision period.

    Raises:
        InputError: they are no whole number.
    """
    steps = round(decision / control)
    if steps < 1 or abs(decision / control - steps) > ROUNDING:
        problem = (
            f"is {control:g} s, of which no whole number makes a decision period, {decision:g} s"
        )
        raise InputError(Fault("physics.control_period", problem))
    return steps
