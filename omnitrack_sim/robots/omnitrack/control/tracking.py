"""Centreline tracking: turn the robot axis towards the pipe's tangent a short way ahead.

The wanted rotation is counted per metre of travel, not per second: what the contacts need to follow
a bend is a matter of distance, and a robot that slows down in a turn hangs in it.

The heading is compared with a stretch of the centreline, from the lookahead point on: a robot that
points anywhere into that stretch is right.
"""

from __future__ import annotations

import math
from ctypes import CFUNCTYPE
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base import rotations
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.pipes.centreline import COLUMNS, place_on, segment_at
from omnitrack_sim.pipes.native import (
    INTEGER,
    NUMBERS,
    WORD,
    WORDS,
    at,
    c_function,
    compiled,
    pointers,
)
from omnitrack_sim.pipes.route_map import (
    AHEAD,
    BRANCH,
    DIRECTION,
    PASSAGE,
    TURN,
    Location,
)
from omnitrack_sim.pipes.vectors import (
    angle_between,
    cross,
    dot,
    in_frame,
    length,
    minus,
    plus,
    put_vector,
    scaled,
    unit,
    vector,
)
from omnitrack_sim.robots.control import ControlSetup
from omnitrack_sim.robots.omnitrack.control.sway import Lean
from omnitrack_sim.robots.omnitrack.kinematics import MODULE_AXES, module_speed, module_speeds
from omnitrack_sim.robots.size import GRAVITY, REFERENCE_BORE

LEADS = 7
"""Points of the stretch that the heading is compared with."""
STEEP, STEEPEST = 0.5, 0.8
"""Weight against a robot, as parts of it, between which the parameters of steep runs set in."""
EQUAL = 1e-9
"""Difference of angles, rad, that is rounding: of equal tangents ahead the first counts."""
LONG_BEND = np.radians(50.0)
"""Bend, rad, from which on its last part, where the robot looks at the straight behind it, is not
asked beside the heading: that would turn a robot on that is round. It saves 4 % of the energy of
turns into a branch and 11 % of those out of it. In wyes of 45 degrees 79 of 80 robots pass
with it, and 68 without."""
TINY = 1e-12
"""Least divisor: what is divided by less is cut to a cap anyway, or is 0."""
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
    # Up to stall, at 15 to 35 N, all of 40 turns pass with 0 and with 2, with 12.4 and 10.4 N of
    # internal traction. With 0.6 N m at 20 to 35 N 39 pass with 0 and with 2, 31 with 4: belts that
    # give way so much no longer bend the robot (docs/explanation/control.md).
    turn_yield: Annotated[NotNegative, Unit("1")] = 2.0
    """Speed by which a belt gives way in such a turn to torque beyond the mean of all, in addition
    to `robot.motor.speed_droop` and as a multiple of it, where the turn does not slip."""
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
    # A motor with little torque bends the robot late, while the weight drags it past the branch.
    # Of 240 turns with half of the weight and more down the run, one attempt, with limits of 0.245
    # to 0.6 N m, 132 pass without it, 150 with 15 mm, 155 with 22, 152 with 30; of 60 up to stall
    # 53, 54, 55 and 54 (docs/explanation/control.md).
    downward_lead: Annotated[NotNegative, Unit("m")] = 0.02
    """Distance by which a turn into a branch begins sooner where the run leads steeply down, for
    motors with no more torque than bending the robot takes; 0 for those with half as much again."""
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


def weakness_of(setup: ControlSetup) -> Array:
    """By how much, 0 to 1, each of n robots lacks torque to turn into a branch.

    1 if its motors give no more than bends it against its springs while it stands in the run, 0 if
    they give half as much again (docs/explanation/control.md).
    """
    robot = setup.robot
    moment = setup.own("preload") * robot.contact_length  # N m
    bends = 2.0 / 3.0 * moment * robot.lug_radius / robot.nominal_pipe_radius  # N m, at the shaft
    # Where no spring presses, or on a point, nothing has to be bent.
    strength = setup.own("motor.max_torque") / np.maximum(bends, TINY)
    return np.clip(3.0 - 2.0 * strength, 0.0, 1.0)


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
        sharper = REFERENCE_BORE / robot.nominal_bore
        self.centring = each["centring"] / robot.length_scale
        self._upward_speed, self._retry_speed = each["upward_speed"], each["retry_speed"]
        self._weight = setup.gravity / GRAVITY  # (n, 3)
        self._rows = np.zeros((setup.n, ROBOT))
        for column, values in (
            (GAIN, each["gain"] * sharper),
            (LIMIT, each["rotation_limit"] * sharper),
            (UPWARD_GAIN, each["upward_gain"] * sharper),
            (UPWARD_LIMIT, each["upward_rotation_limit"] * sharper),
            (UPWARD_LEAD, robot.own_length(each["upward_lead"])),
            (DOWNWARD_LEAD, robot.own_length(each["downward_lead"]) * weakness_of(setup)),
            (SLIP_LEAD, robot.own_length(each["slip_lead"])),
            (MAX_SLOPE, each["max_return_slope"]),
            (WEIGHT, self._weight),
            (LEAD, robot.own_length(each["lookahead"])),
            (STRETCH, robot.own_length(each["heading_lead"])),
        ):
            flat = values.reshape(setup.n, -1)
            self._rows[:, column : column + flat.shape[1]] = flat

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
        rows, wanted = self._rows, np.empty((len(direction), 3))
        rows[:, DISTANCE], rows[:, CURVATURE] = location.distance, location.curvature
        rows[:, ASIDE : ASIDE + 3] = location.aside
        rows[:, TANGENT : TANGENT + 3], rows[:, NORMAL : NORMAL + 3] = (
            location.tangent,
            location.normal,
        )
        rows[:, AXIS : AXIS + 3] = rotation[:, :, 2]
        rows[:, WAY], rows[:, CENTRING] = direction, centring
        rows[:, LEAN : LEAN + 3], rows[:, MAX_LEAN] = lean.aside, lean.limit
        rows[:, SLIP] = lean.slip
        c_function(_wanted_rotations, _WANTED_ROTATIONS).ctypes(
            len(wanted),
            *self.routes.tables,
            *pointers(location.route, location.passage, rows, wanted),
        )
        return wanted

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
        falls = merging & (-rotations.dot(self._weight, towards) > FALLING)
        falls &= (again | slips) & (routes.progress(passage, rotation) < 1.0)
        if np.count_nonzero(falls):
            normal = rotations.cross(routes.ahead.take(passage, axis=0), towards)
            falls &= np.abs(rotations.dot(rotation[:, :, 2], normal)) < IN_PLANE
            in_robot = rotations.dot(normal[:, None], rotation.transpose(0, 2, 1))
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
    count, speeds = len(speed), np.empty((len(speed), 3))
    given = (rotation, angular_velocity, rate_gain, wanted, speed, lever, speed_limit)
    c_function(_wall_speeds, _WALL_SPEEDS).ctypes(
        count,
        *pointers(*(np.ascontiguousarray(each, float) for each in given), MODULE_AXES, speeds),
    )
    return speeds


def _wall_speeds(
    count, rotation, angular_velocity, rate_gain, wanted, speed, lever, speed_limit, modules, speeds
):
    """Write wall speeds (count, 3); see ``wall_speeds``."""
    for i in range(count):
        frame, asked = at(rotation, 9 * i), vector(wanted, 3 * i)
        across = in_frame(frame, asked)
        omega_x, omega_y = across[0] * speed[i], across[1] * speed[i]
        # The rate loop (docs/explanation/control.md): between walls that do not hold it, a robot is
        # turned by its springs as much as by its belts.
        omega_x += rate_gain[i] * (omega_x - angular_velocity[3 * i])
        omega_y += rate_gain[i] * (omega_y - angular_velocity[3 * i + 1])
        for k in range(3):
            cosine, sine = modules[2 * k], modules[2 * k + 1]
            wall = module_speed(speed[i], omega_x, omega_y, lever[i], cosine, sine)
            speeds[3 * i + k] = min(max(wall, -speed_limit[i]), speed_limit[i])
    return 0


_WALL_SPEEDS = CFUNCTYPE(INTEGER, WORD, *[NUMBERS] * 9)

# Columns of a robot in the table of tracking: parameters, then what it is given at each step.
GAIN, LIMIT, UPWARD_GAIN, UPWARD_LIMIT, UPWARD_LEAD, DOWNWARD_LEAD, SLIP_LEAD = range(7)
MAX_SLOPE, LEAD, STRETCH, DISTANCE, CURVATURE, WAY, CENTRING, MAX_LEAN, SLIP = range(7, 16)
WEIGHT, ASIDE, TANGENT, NORMAL, AXIS, LEAN = range(16, 34, 3)
ROBOT = 34


@compiled
def steepness(robot, along):
    """Return by how much, 0 to 1, parameters count of a run that leads steeply ``along`` (3,)."""
    up = -dot(vector(robot, WEIGHT), along)
    return min(max((up - STEEP) / (STEEPEST - STEEP), 0.0), 1.0)


@compiled
def steeply_up(robot, passage):
    """Return the steepness, 0 to 1, of the run that a robot turns into out of a branch."""
    out = passage[BRANCH] > 0.0 and robot[WAY] > 0.0
    return steepness(robot, vector(passage, DIRECTION)) if out else 0.0


@compiled
def steeply_down(robot, passage):
    """Return the steepness, 0 to 1, of the run down which a robot drives into a branch."""
    into = passage[BRANCH] < 0.0 and robot[WAY] > 0.0
    return steepness(robot, scaled(vector(passage, AHEAD), -1.0)) if into else 0.0


@compiled
def tangent_ahead(robot, segments, first, last, lead):
    """Return the tangent of the stretch ahead that is nearest to a robot's axis, and its number."""
    axis, nearest, target, chosen = vector(robot, AXIS), math.inf, vector(robot, AXIS), 0
    for j in range(LEADS):
        s = robot[DISTANCE] + robot[WAY] * (lead + robot[STRETCH] * (j / (LEADS - 1)))
        segment = at(segments, segment_at(segments, first, last, s) * COLUMNS)
        tangent = place_on(segment, s)[1]
        angle = angle_between(axis, tangent)
        if angle < nearest - EQUAL:
            nearest, target, chosen = angle, tangent, j
    return target, chosen


@compiled
def bend_ends(robot, segments, first, last):
    """Return whether a robot in a bend looks at the straight behind it."""
    s = robot[DISTANCE] + robot[WAY] * robot[LEAD]
    segment = at(segments, segment_at(segments, first, last, s) * COLUMNS)
    return robot[CURVATURE] > 0.0 and place_on(segment, s)[3] == 0.0


@compiled
def aimed(robot, target):
    """Return a heading towards ``target``, back to the centreline and leaning."""
    if robot[CENTRING] > 0.0:
        slope = scaled(vector(robot, ASIDE), robot[CENTRING])
        # On the centreline the slope is 0 and has no direction: nothing to divide by.
        share = robot[WAY] * min(1.0, robot[MAX_SLOPE] / max(length(slope), TINY))
        target = unit(minus(target, scaled(slope, share)))
    if robot[MAX_LEAN] > 0.0:
        target = unit(plus(target, vector(robot, LEAN)))
    return target


@compiled
def wanted_of(robot, passage, segments, first, last):
    """Return the rotation wanted of one robot; see ``Tracking.wanted_rotation``."""
    axis, steep = vector(robot, AXIS), steeply_up(robot, passage)
    gain = robot[GAIN] + steep * (robot[UPWARD_GAIN] - robot[GAIN])
    limit = robot[LIMIT] + steep * (robot[UPWARD_LIMIT] - robot[LIMIT])
    # The distance by which the heading lags behind an arc, where belts give 1 - slip of the
    # rotation that is asked. Belts that give none, or a gain of 0, lag without end.
    lag = robot[SLIP] / max((1.0 - robot[SLIP]) * robot[GAIN], TINY)
    sooner = max(min(lag, robot[SLIP_LEAD]), steeply_down(robot, passage) * robot[DOWNWARD_LEAD])
    lead = robot[LEAD] + steep * robot[UPWARD_LEAD] + sooner
    target, chosen = tangent_ahead(robot, segments, first, last, lead)
    target = aimed(robot, target)
    # In proportion to the angle, not to its sine, which would fade beyond 90 degrees.
    rate = robot[WAY] * gain * angle_between(axis, target)
    wanted = scaled(unit(cross(axis, target)), rate)
    # Number 0 is the lookahead point. A robot that has turned ahead of the bend goes straight until
    # the bend has caught up.
    if chosen == 0 and not (passage[TURN] > LONG_BEND and bend_ends(robot, segments, first, last)):
        about = cross(vector(robot, TANGENT), vector(robot, NORMAL))
        wanted = plus(scaled(about, robot[CURVATURE]), wanted)
    limit *= 1.0 + robot[MAX_LEAN]  # the turn goes on while the robot leans
    return scaled(wanted, min(1.0, limit / max(length(wanted), TINY)))


def _wanted_rotations(count, segments, lines, passages, route, passage, robots, wanted):
    """Write wanted rotations (count, 3)."""
    for i in range(count):
        robot, fitting = at(robots, ROBOT * i), at(passages, PASSAGE * passage[i])
        first, last = lines[2 * route[i]], lines[2 * route[i] + 1]
        put_vector(wanted, 3 * i, wanted_of(robot, fitting, segments, first, last))
    return 0


_WANTED_ROTATIONS = CFUNCTYPE(INTEGER, WORD, NUMBERS, WORDS, NUMBERS, WORDS, WORDS, *[NUMBERS] * 2)
