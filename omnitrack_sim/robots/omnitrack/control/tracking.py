"""Centreline tracking: turn the robot axis towards the pipe's tangent a short way ahead.

The wanted rotation is counted per metre of travel, not per second: what the contacts need to follow
a bend is a matter of distance, and a robot that slows down in a turn hangs in it.

The heading is compared with a stretch of the centreline, from the lookahead point on: a robot that
points anywhere into that stretch is right.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from omnitrack_sim.base.rotations import Array, angle_between, cross, dot, length, unit
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.pipes.route_map import Place
from omnitrack_sim.robots.omnitrack.control.interface import ControlSetup
from omnitrack_sim.robots.omnitrack.control.sway import Lean
from omnitrack_sim.robots.omnitrack.kinematics import module_speeds

LEADS = 7
"""Points of the stretch that the heading is compared with."""


class TrackingTable(Table):
    """How the centreline is followed. D is the bore that the robot is made for."""

    # Part of the cruise speed in a turn from a tee's run into its branch. On a slippery wall the
    # weight carries the robot past the branch while it turns: the sooner it is round, the better.
    turn_speed: Annotated[Part, Unit("1")] = 1.3
    """Speed in a turn from a tee's run into its branch, as a part of the cruise speed."""
    gain: Annotated[NotNegative, Unit("rad/D")] = 6.4
    """Rotation for each D of travel while the heading is wrong by 1 rad."""
    lookahead: Annotated[NotNegative, Unit("D")] = 0.1875
    """How far ahead of the robot's centre the centreline's direction is taken."""
    rotation_limit: Annotated[Part, Unit("rad/D")] = 2.4
    """Cap on the rotation for each D of travel; while a robot leans, 1 + tan(lean) times that."""
    heading_lead: Annotated[NotNegative, Unit("D")] = 0.5625
    """Length of the stretch of centreline beyond the lookahead point that the heading may point
    into without being turned back. In the open middle of a tee the robot turns faster than the arc;
    turning it back would push it out of the branch again."""
    centring: Annotated[NotNegative, Unit("1/m")] = 7.0
    """Slope back to the centreline for each metre beside it, on straights and straight over tees;
    given for D = 160 mm, and in proportion to 1/D. Friction holds a robot that leaves a bend beside
    the centreline; 10 mm take all load off a module. 0 leaves it there."""
    steepest_return: Annotated[Part, Unit("rad")] = 0.1
    """Cap on that slope."""


class Tracking:
    """The tracking law of n robots.

    Args:
        setup: of the controller. path: of the ``TrackingTable`` in its parameters.

    Attributes:
        centring: (n,) 1/m, slope towards the centreline that is wanted per metre beside it.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self.routes = setup.routes
        bore = setup.robot.nominal_bore
        each = {name: setup.each(f"{path}.{name}") for name in TrackingTable.model_fields}
        self.gain = each["gain"] / bore  # (n,) 1/m
        self.limit = each["rotation_limit"] / bore  # (n,) rad/m
        self.centring = each["centring"] / setup.robot.length_scale
        self.steepest = each["steepest_return"]
        lead = each["heading_lead"] * bore
        lookahead = each["lookahead"] * bore
        stretches = np.array([np.linspace(0.0, reach, LEADS) for reach in lead])
        self.leads = lookahead[:, None] + stretches  # (n, LEADS) m
        self._rows = np.arange(setup.n)

    def wanted_rotation(
        self, place: Place, rotation: Array, direction: Array, centring: Array, lean: Lean
    ) -> Array:
        """Rotation per metre of travel (n, 3) rad/m, world frame: the bend's curvature plus gain x
        heading error.

        Args:
            place: where the robots are.
            rotation: (n, 3, 3) robot frame in the world.
            direction: (n,) 1 forward, -1 backward: the heading is then compared with the centreline
                behind.
            centring: (n,) 1/m, ``self.centring`` where it is wanted and 0 elsewhere.
            lean: out of the plane of a turn, see ``Sway``.
        """
        axis = rotation[:, :, 2]
        ahead = place.distance[:, None] + direction[:, None] * self.leads  # (n, leads) m
        nearest = self._rows * 0
        target = self.routes.straight(ahead[:, 0], ahead[:, -1], place.way)
        if target is None:
            tangents = self.routes.tangents(ahead, place.way)
            nearest = angle_between(axis[:, None], tangents).argmin(axis=1)
            target = tangents[self._rows, nearest]
        if np.count_nonzero(centring):
            slope = centring[:, None] * place.aside
            steepness = np.maximum(length(slope), 1e-12)
            share = direction * np.minimum(1.0, self.steepest / steepness)
            back = target - share[:, None] * slope
            back = back / length(back)[:, None]
            target = np.where((centring > 0)[:, None], back, target)
        if np.count_nonzero(lean.aside):
            leans = (lean.most > 0)[:, None]
            target = np.where(leans, unit(target + lean.aside), target)
        angle = angle_between(axis, target)
        wanted = unit(cross(axis, target)) * (direction * self.gain * angle)[:, None]
        if np.count_nonzero(place.curvature):
            # A robot that has turned ahead of the bend goes straight until the bend has caught up.
            curvature = place.curvature * (nearest == 0)
            wanted = cross(place.tangent, place.normal) * curvature[:, None] + wanted
        limit = self.limit * (1.0 + lean.most)  # the turn goes on while the robot leans
        return wanted * np.minimum(1.0, limit / np.maximum(length(wanted), 1e-12))[:, None]


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
    omega = omega + rate_gain[:, None] * (omega - angular_velocity[:, :2])
    speeds = module_speeds(speed, omega[:, 0], omega[:, 1], lever)
    limit = speed_limit[:, None]
    return np.minimum(np.maximum(speeds, -limit), limit)
