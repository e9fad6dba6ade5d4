"""Centreline tracking: turn the robot axis towards the pipe's tangent a short way ahead.

The wanted rotation is counted per metre of travel, not per second: what the contacts need to follow
a bend is a matter of distance, and a robot that slows down in a turn hangs in it.

The heading is compared with a stretch of the centreline, from the lookahead point on: a robot that
points anywhere into that stretch is right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array, angle_between, cross, dot, length, unit
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.control.orientation import (
    keeps_the_wall,
    orientation_error,
    preferred_theta5,
)
from omnitrack_sim.robots.omnitrack.kinematics import angular_velocity, module_speeds
from omnitrack_sim.robots.size import GRAVITY, REFERENCE_BORE

LEADS = 7
"""Points of the stretch that the heading is compared with."""
STEEP = (0.5, 0.8)
"""Weight against a robot, as parts of it, between which the parameters of steep runs set in."""
FALLING = 0.75
"""Weight against a robot, as a part of it, beyond which it falls where its belts give way."""
SLIPPERY = 0.5
"""Slip of a turn out of a branch beyond which it falls: up a steep run 0.66 and more where friction
is 0.5 to 0.7, and up to 0.1 on a dry wall, where robots wedge whose outer belts run faster."""
IN_PLANE = np.sin(np.radians(15.0))
"""Sine of the angle to the plane of a turn beyond which a robot is turned back into it first."""


class TrackingTable(Table):
    """Tracking of the centreline. Lengths are for D = 160 mm and grow with the robot's bore."""

    # Part of the cruise speed in a turn from a tee's run into its branch. On a slippery wall the
    # weight carries the robot past the branch while it turns: the sooner it is round, the better.
    turn_speed: Annotated[Part, Unit("1")] = 1.3
    """Speed in a turn from a tee's run into its branch, as a part of the cruise speed."""
    gain: Annotated[NotNegative, Unit("rad/m")] = 40.0
    """Rotation for each metre of travel while the heading is wrong by 1 rad."""
    # Up a run the robot falls back into its other half while it turns. On slippery walls (friction
    # 0.5 to 0.58, 20 to 27 N) 54 of 80 pass with the three values, 49 without the lead, 33 with
    # those of other turns.
    upward_gain: Annotated[NotNegative, Unit("rad/m")] = 60.0
    """Gain out of a branch where the run leads steeply up."""
    lookahead: Annotated[NotNegative, Unit("m")] = 0.03
    """Distance ahead of the robot's centre at which the centreline's direction is taken."""
    rotation_limit: Annotated[Part, Unit("rad/m")] = 15.0
    """Cap on the rotation for each metre of travel; while a robot leans, 1 + tan(lean) times
    that."""
    upward_lead: Annotated[NotNegative, Unit("m")] = 0.015
    """Distance by which a turn out of a branch begins sooner where the run leads steeply up."""
    # On slippery walls with the weight down the run (friction 0.5 to 0.58, 20 to 26 N) 120 of 160
    # turns that lean in full pass without it, 128 with 10 mm, 134 with 15, 133 with 20, 123 with
    # 25.
    slip_lead: Annotated[NotNegative, Unit("m")] = 0.015
    """Most by which a turn that has slipped is begun sooner at the next attempt."""
    heading_lead: Annotated[NotNegative, Unit("m")] = 0.09
    """Length of centreline beyond the lookahead point within which the heading is not turned
    back. In the open middle of a tee the robot turns faster than the arc, and turning it back
    would push it out of the branch."""
    upward_rotation_limit: Annotated[Part, Unit("rad/m")] = 30.0
    """Cap on the rotation out of a branch where the run leads steeply up."""
    # The springs throw the robot over, and belts that hold against that at the far wall drive it
    # down. Up slippery runs (friction 0.5 to 0.65, 20 to 27 N, 0.6 and more of the weight against
    # the robot) 88 of 96 pass with 2, 83 with 1, 82 with 0, 84 without; below 0.75 of the weight
    # as many are lost as are gained.
    upward_speed: Annotated[NotNegative, Unit("1")] = 2.0
    """Least speed of the outer belts out of a branch where the run leads steeply up, until the
    robot is round, as a part of the cruise speed. 0: none."""
    # A belt that brakes at the rim holds a robot as well as the others push it.
    retry_speed: Annotated[NotNegative, Unit("1")] = 0.5
    """Least speed of all belts out of a branch when a robot tries again, as a part of the cruise
    speed. 0: none."""
    centring: Annotated[NotNegative, Unit("1/m")] = 7.0
    """Slope back to the centreline for each metre of offset, on straights and straight over
    tees; for D = 160 mm, in proportion to 1/D. Friction holds a robot off the centreline, and
    10 mm take all load off a module. 0: none."""
    max_return_slope: Annotated[Part, Unit("rad")] = 0.1
    """Cap on that slope."""


class Tracking:
    """The tracking law of n robots.

    Args:
        setup: of the controller.
        path: of the ``TrackingTable`` in its parameters.

    Attributes:
        centring: (n,) 1/m, slope towards the centreline that is wanted per metre beside it.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self.routes = setup.routes
        robot = setup.robot
        each = {name: setup.each(f"{path}.{name}") for name in TrackingTable.model_fields}
        self.gain = each["gain"] * REFERENCE_BORE / robot.nominal_bore  # (n,) rad/m
        self.limit = each["rotation_limit"] * REFERENCE_BORE / robot.nominal_bore
        self.centring = each["centring"] / robot.length_scale
        self.max_return_slope = each["max_return_slope"]
        lead, lookahead = (
            robot.own_length(each["heading_lead"]),
            robot.own_length(each["lookahead"]),
        )
        stretches = np.array([np.linspace(0.0, reach, LEADS) for reach in lead])
        self.leads = lookahead[:, None] + stretches  # (n, LEADS) m
        self._slip_lead = robot.own_length(each["slip_lead"])  # (n,) m
        self._upward_lead = robot.own_length(each["upward_lead"])  # (n,) m
        self._upward_gain = each["upward_gain"] * REFERENCE_BORE / robot.nominal_bore
        self._upward_limit = each["upward_rotation_limit"] * REFERENCE_BORE / robot.nominal_bore
        self._upward_speed, self._retry_speed = each["upward_speed"], each["retry_speed"]
        self._weight = setup.gravity / GRAVITY  # (n, 3)
        self._rows = np.arange(setup.n)

    def wanted_rotation(
        self, location: Location, rotation: Array, direction: Array, centring: Array, lean: Lean
    ) -> Array:
        """Rotation per metre of travel (n, 3) rad/m, world frame.

        It is the bend's curvature plus gain x heading error.

        Args:
            location: where the robots are.
            rotation: (n, 3, 3) robot frame in the world.
            direction: (n,) 1 forward, -1 backward: the heading is then compared with the centreline
                behind.
            centring: (n,) 1/m, ``self.centring`` where it is wanted and 0 elsewhere.
            lean: out of the plane of a turn, see ``Sway``.
        """
        axis, routes, passage = rotation[:, :, 2], self.routes, location.passage
        leads, gain, limit = self.leads, self.gain, self.limit
        merging = routes.out_of_branch.take(passage) & (direction > 0)
        if np.count_nonzero(merging):
            up = -dot(self._weight, routes.directions.take(passage, axis=0))
            sharper = np.interp(up, STEEP, (0.0, 1.0)) * merging
            leads = leads + (sharper * self._upward_lead)[:, None]
            gain = gain + sharper * (self._upward_gain - gain)
            limit = limit + sharper * (self._upward_limit - limit)
        if np.count_nonzero(lean.slip):
            # The distance by which the heading lags behind an arc, where belts give 1 - slip of the
            # rotation that is asked.
            lag = lean.slip / ((1.0 - lean.slip) * self.gain)
            leads = leads + np.minimum(lag, self._slip_lead)[:, None]
        ahead = location.distance[:, None] + direction[:, None] * leads  # (n, leads) m
        # Index 0 is the lookahead point; on a straight stretch all points have its tangent.
        nearest = self._rows * 0
        target = self.routes.straight(ahead[:, 0], ahead[:, -1], location.route)
        if target is None:
            tangents = self.routes.tangents(ahead, location.route)
            nearest = angle_between(axis[:, None], tangents).argmin(axis=1)
            target = tangents[self._rows, nearest]
        if np.count_nonzero(centring):
            slope = centring[:, None] * location.aside
            # On the centreline the slope is 0 and has no direction: nothing to divide by.
            steepness = np.maximum(length(slope), 1e-12)
            share = direction * np.minimum(1.0, self.max_return_slope / steepness)
            back = target - share[:, None] * slope
            back = back / length(back)[:, None]
            target = np.where((centring > 0)[:, None], back, target)
        if np.count_nonzero(lean.aside):
            leans = (lean.limit > 0)[:, None]
            target = np.where(leans, unit(target + lean.aside), target)
        angle = angle_between(axis, target)
        # In proportion to the angle, not to its sine, which would fade beyond 90 degrees.
        wanted = unit(cross(axis, target)) * (direction * gain * angle)[:, None]
        if np.count_nonzero(location.curvature):
            # A robot that has turned ahead of the bend goes straight until the bend has caught up.
            curvature = location.curvature * (nearest == 0)
            wanted = cross(location.tangent, location.normal) * curvature[:, None] + wanted
        limit = limit * (1.0 + lean.limit)  # the turn goes on while the robot leans
        return wanted * np.minimum(1.0, limit / np.maximum(length(wanted), 1e-12))[:, None]

    def forward_out_of_branch(
        self,
        wall_speed: Array,
        location: Location,
        rotation: Array,
        slips: NDArray[np.bool_],
        again: NDArray[np.bool_],
        speed: Array,
    ) -> Array:
        """Raise the wall speeds (n, 3) m/s of robots on the way out of a branch.

        By ``upward_speed`` and ``retry_speed``.

        Args:
            wall_speed: (n, 3) m/s, as wanted for the rotation.
            location: where the robots are.
            rotation: (n, 3, 3) robot frame in the world.
            slips: (n,) robots whose turn slips, or may slip.
            again: (n,) robots that try again.
            speed: (n,) m/s, that of cruising.
        """
        passage, routes = location.passage, self.routes
        towards = routes.directions.take(passage, axis=0)
        merging = routes.out_of_branch.take(passage)
        least = np.where(merging & again, self._retry_speed * speed, 0.0)[:, None]
        falls = merging & (-dot(self._weight, towards) > FALLING)
        falls &= (again | slips) & (routes.progress(passage, rotation) < 1.0)
        if np.count_nonzero(falls):
            normal = cross(routes.ahead.take(passage, axis=0), towards)
            falls &= np.abs(dot(rotation[:, :, 2], normal)) < IN_PLANE
            in_robot = dot(normal[:, None], rotation.transpose(0, 2, 1))
            turning = module_speeds(0.0 * speed, in_robot[:, 0], in_robot[:, 1], 1.0 + 0.0 * speed)
            outer = falls[:, None] & (turning > 0)
            least = np.where(outer, np.maximum(least, (self._upward_speed * speed)[:, None]), least)
        return np.where(least > 0, np.maximum(wall_speed, least), wall_speed)


def wall_speeds(
    rotation: Array,
    angular_velocity: Array,
    rate_gain: Array,
    wanted: Array,
    speed: Array,
    lever: Array,
    speed_limit: Array,
) -> Array:
    """Wall speeds (n, 3) m/s of the modules for a wanted rotation per metre.

    Args:
        rotation: (n, 3, 3) robot frame in the world.
        angular_velocity: (n, 3) rad/s, robot frame, as it is.
        rate_gain: (n,) rotation asked in addition, per rad/s that the rotation is too slow or too
            fast.
        wanted: (n, 3) rad/m, world frame.
        speed: (n,) m/s forward.
        lever: (n,) m, distance of the walls from the robot's axis.
        speed_limit: (n,) m/s, cap on each speed.
    """
    across = dot(wanted[:, None], rotation.transpose(0, 2, 1)[:, :2])  # (n, 2) rad/m about x and y
    omega = across * speed[:, None]
    # The rate loop (docs/explanation/control.md): between walls that do not hold it, a robot is
    # turned by its springs as much as by its belts.
    omega = omega + rate_gain[:, None] * (omega - angular_velocity[:, :2])
    speeds = module_speeds(speed, omega[:, 0], omega[:, 1], lever)
    limit = speed_limit[:, None]
    return np.minimum(np.maximum(speeds, -limit), limit)


class SwayTable(Table):
    """Parameters of the sway in a turn from a tee's run into its branch.

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
    # A robot that has slid past the branch hardly ever comes back (docs/studies/tee-turn.md). With
    # 0.4 from a tenth of the turn on, 25 of 120 robots begin again with friction 0.6 to 0.75 and 19
    # to 24 N, of which all would have passed and 2 fail; with 0.55 from 0.15 on 5, and none fails.
    begin_again: Annotated[NotNegative, Unit("1")] = 0.55
    """Slip in the beginning of a turn beyond which the robot backs off to try again at once."""


@dataclass(frozen=True)
class SwayProfile:
    """Lean over the course of a turn into a branch.

    Attributes:
        progress: rotation so far at which ``lean`` stands, as parts of the turn.
        lean: lean there, as parts of the largest; linear between. The swing back begins early: a
            robot follows it by about a ninth of the turn later.
        judged: part of the turn after which its slip is no longer measured. Farther on the inner
            module may have lost its wall, and its belt then turns nothing on a dry wall either.
        min_turn: rad, rotation by the belts that is enough to tell how much of it slips.
        beginning: parts of the turn between which it can be begun again. Before, belts that have
            just begun to turn a robot slip on dry walls, too; farther on it no longer comes back.
    """

    progress: tuple[float, ...] = (1 / 9, 1 / 3, 5 / 9, 7 / 9)
    lean: tuple[float, ...] = (-0.15, 1.0, 0.5, 0.0)
    judged: float = 1 / 3
    min_turn: float = np.radians(5.0)
    beginning: tuple[float, float] = (0.15, 0.3)


SWAY = SwayProfile()
MAX_SLIP = 0.9
"""Slip beyond which no more is made of it: a robot may also be turned back."""


class Lean(NamedTuple):
    """Set point of the lean of n robots.

    Attributes:
        aside: (n, 3) added to the unit vector of the wanted heading, world frame.
        limit: (n,) largest size of ``aside`` in this turn.
        slip: (n,) that of the turn at the first attempt, up to ``MAX_SLIP``, where robots try
            again; 0 of the others.
    """

    aside: Array
    limit: Array
    slip: Array


class Sway:
    """The sway of n robots.

    A robot leans to the side of the turn's plane that the inner module, the one nearest to the
    branch, is not on when the turn begins.

    Args:
        setup: of the controller.
        path: of the ``SwayTable`` in its parameters.

    Attributes:
        by_belts: (n,) rad, rotation in the first part of the turn by the speeds of the belts; of
            turns out of a branch, too.
        turned: (n,) rad, the same by the gyroscope.
        slides: (n,) bool, robots that slip so much in the beginning of a turn that they had better
            begin it again.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self._path = path
        self._side, self.by_belts, self.turned, self._slipped = np.zeros((4, setup.n))
        self.slides = np.zeros(setup.n, bool)
        self._best = preferred_theta5("tee_turn")
        # While no robot turns and none has slipped, the last location is all that is kept.
        self._idle = False
        self._before: Location | None = None
        self._upright = Lean(np.zeros((setup.n, 3)), np.zeros(setup.n), np.zeros(setup.n))
        self.reset(np.arange(setup.n), setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self._catch_up()
        self.routes, self.period = setup.routes, setup.period
        each = {name: setup.each(f"{self._path}.{name}") for name in SwayTable.model_fields}
        # Added across a unit vector, a tangent turns it by the angle.
        self._max_lean = np.tan(np.radians(each["lean_deg"]))  # (n,)
        self._slip, self._slip_range = each["slip"], each["slip_range"]
        # Leaning needs both outer modules at the wall.
        self._begin_again = np.where(keeps_the_wall(setup), each["begin_again"], np.inf)
        self._side[rows], self.by_belts[rows], self.turned[rows] = 1.0, 0.0, 0.0
        self._slipped[rows], self.slides[rows] = 0.0, False

    @property
    def known(self) -> NDArray[np.bool_]:
        """Robots (n,) that belts have turned far enough to tell the slip."""
        return self.by_belts > SWAY.min_turn

    @property
    def slip(self) -> Array:
        """Slip of the turn (n,), 1; zero as long as it is not known."""
        return np.where(
            self.known, 1.0 - self.turned / np.maximum(self.by_belts, SWAY.min_turn), 0.0
        )

    def step(
        self,
        observation: Observation,
        turning: NDArray[np.bool_],
        merging: NDArray[np.bool_],
        full: NDArray[np.bool_],
    ) -> Lean:
        """Return the set point of the lean.

        Args:
            observation: of this moment.
            turning: (n,) robots that turn into a branch now.
            merging: (n,) robots that turn out of one now, whose slip is measured.
            full: (n,) robots that sway in full at any slip, as they try again.
        """
        location, measured = observation.location, turning | merging
        nobody = not np.count_nonzero(measured)
        if nobody and self._idle:
            self._before = location
            return self._upright
        self._catch_up()
        self._side = np.where(turning, self._side, self._side_of(location))
        self._slipped = np.where(full, self._slipped, np.clip(self.slip, 0.0, MAX_SLIP))
        again = np.where(full & turning, self._slipped, 0.0)
        self._idle = nobody and not np.count_nonzero(self._slipped)
        if nobody:
            self.by_belts, self.turned = 0 * self.by_belts, 0 * self.turned
            self.slides = turning  # none
            return self._upright._replace(slip=again)
        passage, rotation = location.passage, observation.rotation
        ahead = self.routes.ahead.take(passage, axis=0)
        towards = self.routes.directions.take(passage, axis=0)
        normal = cross(ahead, towards)
        progress = self.routes.progress(passage, rotation)
        in_robot = dot(normal[:, None], rotation.transpose(0, 2, 1))
        radius = self.routes.radius.take(passage)
        # The lever is the pipe's radius: tracks act at the wall (docs/explanation/kinematics.md).
        belts = dot(angular_velocity(observation.wall_speed, 0.0, radius), in_robot)
        gyro = dot(observation.angular_velocity, in_robot)
        elapsed = np.where(measured & (progress < SWAY.judged), self.period, 0.0)
        self.by_belts = np.where(measured, self.by_belts, 0.0) + elapsed * belts
        self.turned = np.where(measured, self.turned, 0.0) + elapsed * gyro
        start, end = SWAY.beginning
        begins = turning & ~full & (progress >= start) & (progress < end)
        self.slides = begins & (self.slip > self._begin_again)
        share = np.clip((self.slip - self._slip) / self._slip_range, 0.0, 1.0)
        share = np.where(full, 1.0, share)
        limit = np.where(turning, self._max_lean * share, 0.0)
        # Back at 0 before the turn ends: the robot has to leave it in its plane.
        size = self._side * limit * np.interp(progress, SWAY.progress, SWAY.lean)
        return Lean(size[:, None] * normal, limit, again)

    def _catch_up(self) -> None:
        """Take up the side of the turn's plane at the last location of robots that did not turn."""
        if self._before is not None:
            self._side, self._before = self._side_of(self._before), None

    def _side_of(self, location: Location) -> Array:
        """Side (n,) of a turn's plane to lean to, 1 or -1, by the orientation before the turn."""
        # Equal orientations lean alike: theta5 = -115 is 5 degrees beside the best, as 5 itself.
        return np.where(orientation_error(location.theta5, self._best) < 0, 1.0, -1.0)
