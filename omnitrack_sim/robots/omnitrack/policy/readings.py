"""What the shipped features read: functions from a view of n robots to (n,) or (n, k)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack import GRAVITY
from omnitrack_sim.robots.omnitrack.policy.feature import View

AHEAD = (0.25, 0.75, 1.5)
"""How far ahead of the robot's centre the preview takes the centreline's direction, D: where the
default controller looks, the robot's nose, and a robot's length ahead."""


def wall_speed(view: View) -> Array:
    return view.observation.wall_speed / view.setup.settings.speed_limit[:, None]


def wall_torque(view: View) -> Array:
    limit = view.setup.robot.crawler_motor.torque_limit
    return view.observation.motor_torque * view.forward / limit


def half_turns(view: View) -> Array:
    roll = view.observation.roll
    return np.stack([np.cos(2 * roll).mean(axis=-1), np.sin(2 * roll).mean(axis=-1)], axis=-1)


def circle(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def doubt(view: View) -> Array:
    std = view.observation.place.theta5_std
    return np.zeros(view.setup.n) if std is None else std


def aside(view: View) -> Array:
    return view.in_robot(view.observation.place.aside)[:, :2] / view.setup.robot.nominal_bore


def cruise_speed(view: View) -> Array:
    return view.setup.settings.cruise_speed / view.setup.settings.speed_limit


def to(mark: str) -> Callable[[View], Array]:
    """Way from the robot's centre to an end of the fitting that it is in or comes to, D."""

    def read(view: View) -> Array:
        place = view.observation.place
        at = getattr(view.setup.routes, mark).take(place.passage)
        return (at - place.distance) / view.setup.robot.nominal_bore

    return read


def of_passage(name: str) -> Callable[[View], Array]:
    """What the route map says of that fitting."""
    return lambda view: getattr(view.setup.routes, name).take(view.observation.place.passage)


def kind(view: View) -> Array:
    routes, passage = view.setup.routes, view.observation.place.passage
    kinds = (
        routes.is_turn & ~routes.is_tee_turn,
        routes.into_branch,
        routes.out_of_branch,
        routes.is_straight_over,
    )
    return np.stack([kind.take(passage) for kind in kinds], axis=-1).astype(float)


def turn(view: View) -> Array:
    return np.degrees(of_passage("turn")(view)) * of_passage("is_turn")(view)


def bend(view: View) -> Array:
    return view.setup.robot.nominal_bore / of_passage("bend_radius")(view)


def bore(view: View) -> Array:
    return of_passage("radius")(view) / view.setup.robot.nominal_pipe_radius - 1


def way_ahead(view: View) -> Array:
    place, setup = view.observation.place, view.setup
    ahead = place.distance[:, None] + np.array(AHEAD) * setup.robot.nominal_bore
    tangents = setup.routes.tangents(ahead, place.way)  # (n, leads, 3)
    return np.concatenate([view.in_robot(tangents[:, i]) for i in range(len(AHEAD))], axis=-1)


def over_weight(channel: str) -> Callable[[View], Array]:
    def read(view: View) -> Array:
        return getattr(view.observation, channel) / (view.setup.robot.mass * GRAVITY)

    return read


def over_limit(channel: str) -> Callable[[View], Array]:
    def read(view: View) -> Array:
        return getattr(view.observation, channel) / view.setup.settings.speed_limit[:, None]

    return read


def touching(view: View) -> Array:
    return (view.observation.contact_count > 0).reshape(-1, 6).astype(float)
