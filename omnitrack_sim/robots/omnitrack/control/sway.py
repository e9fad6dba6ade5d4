"""Sway: a robot whose inner module slips in a turn into a branch swings its nose out of the plane
of the turn and back.

The inner module, which brakes, is what a robot turns about. Where it slips, the weight and the
outer modules, which hold along their belts, carry the robot past the branch before it is round. A
swing across the turn makes the two outer belts run against each other, and they carry it no longer.
docs/control.md has what that is worth.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array, cross, dot
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.robots.omnitrack.control.interface import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.kinematics import angular_velocity

PROGRESS = np.array([1 / 9, 1 / 3, 5 / 9, 7 / 9])
"""How far a robot has turned, in parts of the turn, where ``SHAPE`` is given."""
SHAPE = np.array([-0.15, 1.0, 0.5, 0.0])
"""Lean at ``PROGRESS``, in parts of the largest; linear between."""
JUDGED = float(PROGRESS[1])
"""How far a robot has turned when its slip is judged for good. Farther on the inner module may have
lost its wall, and its belt then turns nothing on a dry wall either."""
LEAST_TURN = np.radians(5.0)
"""Rotation by the belts that is enough to tell how much of it slips."""


class SwayTable(Table):
    """How a robot sways in a turn from a tee's run into its branch.

    The slip of the turn is the part of the rotation by the belts that the gyroscope does not see.
    """

    lean_deg: Annotated[float, Field(ge=0, le=80)] = 40.0
    """Largest lean that is asked for, 0 to 80; a robot reaches half of it. 0: none."""
    # A turn with less slip is left alone. On a dry wall it is -0.14 to -0.02, in turns that fail
    # without sway 0.23 and more.
    slip: Annotated[NotNegative, Unit("1")] = 0.1
    """A turn that slips no more than this is left alone."""
    slip_range: Annotated[Part, Unit("1")] = 0.2
    """Slip beyond that with which the lean is in full."""


class Lean(NamedTuple):
    """How n robots shall lean.

    Attributes:
        aside: (n, 3) is added to the direction that they shall turn to, world frame.
        most: (n,) the largest size that it has in this turn.
    """

    aside: Array
    most: Array


class Sway:
    """The sway of n robots.

    A robot leans to the side of the turn's plane that module 1 is not on when the turn begins.

    Args:
        setup: of the controller. path: of the ``SwayTable`` in its parameters.

    Attributes:
        by_belts, turned: (n,) rad, how far robots have turned in the first part of their turn by
            the speeds of their belts, and by the gyroscope.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self.routes, self.period = setup.routes, setup.period
        each = {name: setup.each(f"{path}.{name}") for name in SwayTable.model_fields}
        self._most = np.tan(np.radians(each["lean_deg"]))  # (n,)
        self._slip, self._slip_range = each["slip"], each["slip_range"]
        self._side = np.ones(setup.n)
        self.by_belts, self.turned = np.zeros(setup.n), np.zeros(setup.n)

    @property
    def slip(self) -> Array:
        """Slip of the turn (n,), 1; zero as long as belts have not turned a robot far enough."""
        known = self.by_belts > LEAST_TURN
        return np.where(known, 1.0 - self.turned / np.maximum(self.by_belts, LEAST_TURN), 0.0)

    def step(
        self, observation: Observation, turning: NDArray[np.bool_], full: NDArray[np.bool_]
    ) -> Lean:
        """How robots shall lean now.

        Args:
            observation: of this moment. turning: (n,) robots that turn into a branch now.
            full: (n,) robots that sway in full, whatever slips.
        """
        place = observation.place
        beside = np.where(place.theta5 < 0, 1.0, -1.0)
        self._side = np.where(turning, self._side, beside)
        if not np.count_nonzero(turning):
            self.by_belts, self.turned = 0 * self.by_belts, 0 * self.turned
            return Lean(np.zeros((len(turning), 3)), np.zeros(len(turning)))
        passage, rotation = place.passage, observation.rotation
        ahead = self.routes.ahead.take(passage, axis=0)
        towards = self.routes.directions.take(passage, axis=0)
        normal = cross(ahead, towards)
        axis = rotation[:, :, 2]
        heading = np.arctan2(dot(axis, towards), dot(axis, ahead))
        progress = heading / self.routes.turn.take(passage)
        in_robot = dot(normal[:, None], rotation.transpose(0, 2, 1))
        radius = self.routes.radius.take(passage)
        belts = dot(angular_velocity(observation.wall_speed, 0.0, radius), in_robot)
        gyro = dot(observation.angular_velocity, in_robot)
        elapsed = np.where(turning & (progress < JUDGED), self.period, 0.0)
        self.by_belts = np.where(turning, self.by_belts, 0.0) + elapsed * belts
        self.turned = np.where(turning, self.turned, 0.0) + elapsed * gyro
        share = np.clip((self.slip - self._slip) / self._slip_range, 0.0, 1.0)
        share = np.where(full, 1.0, share)
        most = np.where(turning, self._most * share, 0.0)
        size = self._side * most * np.interp(progress, PROGRESS, SHAPE)
        return Lean(size[:, None] * normal, most)
