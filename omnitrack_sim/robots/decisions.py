"""Decisions of a learner: from numbers within -1 and 1 to the control inputs of any robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.control import Actuation, ControlSetup, Observation
from omnitrack_sim.robots.feature import (
    PLACE,
    ROUTE,
    Feature,
    FeatureInput,
    FloatRows,
    entries_of,
    held_actions,
    select_features,
    steps_of_decision,
)
from omnitrack_sim.robots.scene import compiled

if TYPE_CHECKING:
    from omnitrack_sim.robots.robot import Robot

FASTEST = 20.0
"""Joint speed that counts as largest, rad/s or m/s, where a learner observes it."""


class InputDecisions:
    """Decisions of n robots on their control inputs: -1 and 1 are the ends of each input's range.

    Args:
        setup: of the controller.
        features: in the order of the observation's entries.
        acting: one of ``actings``.

    Raises:
        InputError: an input has no range.

    Attributes:
        hold: control steps of a decision period.
        action: (n, nu), the last decision; before the first one that of the inputs at the start.
        actings: ways to act by name; what each means is the class's own affair.
        of_truth: features that no robot's own sensors give.
        measured: the default features are what the sensors of a robot with odometry measure.
        ranges: least and largest value of what each episode draws, by dotted path.
    """

    actings: ClassVar[Mapping[str, Any]] = {"direct": None}
    of_truth: ClassVar[tuple[Feature, ...]] = ()
    measured: ClassVar[bool] = False
    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {
        "world.friction": (0.6, 1.0),
        "start.theta5_deg": (-180.0, 180.0),
    }

    def __init__(
        self,
        setup: ControlSetup,
        features: Sequence[Feature],
        acting: Any = None,  # noqa: ARG002 - protocol
    ) -> None:
        self.features, self.hold = tuple(features), steps_of_decision(setup.period)
        low, high = setup.robot.input_range.T
        self._middle, self._half = (low + high) / 2, (high - low) / 2
        self.action = np.zeros((setup.n, len(low)))
        self.reset(np.arange(setup.n), setup)

    @classmethod
    def actions_of(cls, robot: Robot) -> tuple[str, ...]:
        """Return the names of the entries of an action: those of the actuators."""
        model = compiled(robot)
        return tuple(model.actuator(i).name or f"input_{i}" for i in range(model.nu))

    @classmethod
    def features_of(cls, robot: Robot, names: str | Sequence[str] | None) -> tuple[Feature, ...]:
        """Return features by names, as ``select_features`` does; None: the set ``joints``.

        The sets are ``joints``, which the robot can measure, where it lies in the pipe included,
        and ``route``, the joints and the route ahead.
        """
        joints = (*_joint_features(robot), *PLACE)
        sets = {"joints": joints, "route": (*joints, *ROUTE)}
        shipped = {**sets, **{feature.name: feature for feature in sets["route"]}}
        return select_features("joints" if names is None else names, "observation", shipped)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self.setup = setup
        start = (setup.command.ctrl[rows] - self._middle) / self._half
        self.action[rows] = np.minimum(np.maximum(start, -1.0), 1.0)

    def observe(self, observation: Observation) -> FloatRows:
        """Return the entries (n, k) of all features."""
        return entries_of(self.features, FeatureInput(self.setup, observation, self.action))

    def decide(self, action: ArrayLike) -> None:
        """Set the actions (n, nu) of all robots, cut off at -1 and 1; see ``held_actions``."""
        self.action = held_actions(action, self.action)

    def command(self, observation: Observation) -> Actuation:  # noqa: ARG002 - protocol
        """Return the command for the next control period."""
        return Actuation(self._middle + self.action * self._half)


def _joint_features(robot: Robot) -> tuple[Feature, ...]:
    """Positions and speeds of a robot's joints but the free one, and its last decision."""
    names = tuple(name for name, at in robot.joints.items() if at.stop - at.start == 1)
    actions = InputDecisions.actions_of(robot)
    last = Feature("last_action", "1", -1, 1, "what was decided last", lambda m: m.action, actions)
    if not names:
        return (last,)
    return (
        Feature(
            "joint_position",
            "1",
            -1,
            1,
            "sine of each hinge's angle; way of each slide joint over D/10",
            _joint_positions,
            names,
        ),
        Feature(
            "joint_speed",
            "rad/s, D/s",
            -FASTEST,
            FASTEST,
            "speed of each joint",
            _joint_speeds,
            names,
        ),
        last,
    )


def _joint_positions(m: FeatureInput) -> Array:
    model, bore = m.setup.model, m.setup.robot.nominal_bore
    joints = _single(model)
    position = m.observation.qpos.take(model.jnt_qposadr[joints], axis=1)
    # Wheels turn on and on: an angle would leave any range.
    return np.where(_slides(model, joints), position / (0.1 * bore), np.sin(position))


def _joint_speeds(m: FeatureInput) -> Array:
    model, bore = m.setup.model, m.setup.robot.nominal_bore
    joints = _single(model)
    speed = m.observation.qvel.take(model.jnt_dofadr[joints], axis=1)
    return np.where(_slides(model, joints), speed / bore, speed)


def _single(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Numbers of the joints with one degree of freedom."""
    kinds = (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
    return np.flatnonzero(np.isin(model.jnt_type, kinds))


def _slides(model: mujoco.MjModel, joints: NDArray[np.intp]) -> NDArray[np.bool_]:
    return model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE
