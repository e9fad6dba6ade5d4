"""Odometry: what a robot's own body measures of its motion and of the pipe around it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import shown
from omnitrack_sim.record.channels import Channel

if TYPE_CHECKING:
    from omnitrack_sim.robots.robot import Robot
    from omnitrack_sim.robots.sensor import State


class BodyReadings(NamedTuple):
    """Readings of the sensors in the bodies of n robots, over one control period.

    Attributes:
        travel: (n, w) m, by which each driven surface has moved on.
        angle: (n, a) rad, of other joints with an encoder.
        arm: (n, b) m, of limbs that are pressed to the wall.
        torque: (n, m) N m, of motors, by their current.

    Example:
        >>> import numpy as np
        >>> none = np.zeros((1, 0))
        >>> body = ot.BodyReadings(np.array([[0.001, 0.003]]), none, none, none)  # two wheels
        >>> body.travel.mean(axis=1)
        array([0.002])
    """

    travel: Array
    angle: Array
    arm: Array
    torque: Array


class Motion(NamedTuple):
    """Motion of n robots over one control period as their drives ask for it, robot frame.

    Attributes:
        travel: (n,) m, along the robot's axis.
        slip_std: (n,) standard deviation of the drives' slip beyond that of every robot
            (``sensing.filter``), as a part of the travel.
        rotation: (n, 3) rad, rotation vector. Where the gyro measures another one, drives slip.
        rotation_std: (n, 3) rad, of its components; infinite about axes of which drives tell
            nothing.

    Example:
        >>> import numpy as np
        >>> ot.Motion.along(np.array([0.002])).rotation_std
        array([[inf, inf, inf]])
    """

    travel: Array
    slip_std: Array
    rotation: Array
    rotation_std: Array

    @classmethod
    def along(cls, travel: Array) -> Motion:
        """Return a motion of which the drives tell the travel (n,) m alone."""
        nothing = np.zeros((len(travel), 3))
        return cls(travel, np.zeros(len(travel)), nothing, nothing + math.inf)


def rotation_by_sides(travel: Array, angles: Array, radius: float) -> Array:
    """Return the rotation (n, 3) rad, robot frame, that surfaces around a robot's axis ask for.

    In a bend the surface at the angle a about the axis, from x towards y, moves on by

        u + R (omega_x sin a - omega_y cos a),    u: travel of the robot

    of which this is the least-squares solution for surfaces that are evenly spread about the axis.
    Of the rotation about the axis itself they tell nothing; it is 0.

    Args:
        travel: (n, w) m, of the surfaces.
        angles: (w,) rad.
        radius: R, m, from the axis to where they touch the wall.

    Example:
        >>> import numpy as np
        >>> from omnitrack_sim.robots.odometry import rotation_by_sides
        >>> sides = np.radians([0.0, 120.0, 240.0])
        >>> travel = 0.01 - 0.08 * 0.05 * np.cos(sides)  # 0.05 rad about y
        >>> rotation_by_sides(travel[None], sides, 0.08).round(6)
        array([[0.  , 0.05, 0.  ]])
    """
    across = np.stack([np.sin(angles), -np.cos(angles), np.zeros(len(angles))], axis=-1)
    # Zero by symmetry, and not left to rounding: two surfaces only tell of their own plane.
    return 2 / (len(angles) * radius) * (travel - travel.mean(axis=1, keepdims=True)) @ across


class Limbs(NamedTuple):
    """Limbs of n robots, each pressed outward until one of its points touches the wall.

    Attributes:
        points: (n, b, p, 3) m, robot frame, of which the one nearest to the wall touches it.
        pressed: (n, b) bool, limbs that may touch: none that has come to its outer stop.

    Example:
        >>> import numpy as np
        >>> presser = ot.load_scenario("robots/presser_tee").robot
        >>> body = ot.BodyReadings(np.zeros((1, 6)), np.zeros((1, 0)), *np.zeros((2, 1, 3)))
        >>> points = presser.odometry().limbs(body).points
        >>> np.hypot(points[..., 0], points[..., 1]).max().round(4)  # its tyres touch the bore
        np.float64(0.08)
    """

    points: Array
    pressed: NDArray[np.bool_]


class LookAround(NamedTuple):
    """What robots that have lost their pose are to do now, to see their pipe from elsewhere.

    Attributes:
        robots: (n,) bool, those that it is for.
        speed: (n,) m/s, at which they creep, backward in their gear where it is negative; 0: they
            stand still.
        turn: (n,) rad, by which they are to have turned their contacts about their axis since they
            lost their pose; 0 where ``Odometry.roll_rate`` is 0.
        gear: (n,) 1 nose first, -1 tail first.
        begun: (n, ...) readings, as controllers receive them, as each lost its pose.
        readings: (n, ...) the same now.

    Example:
        >>> import numpy as np
        >>> presser = ot.load_scenario("robots/presser_tee").robot
        >>> one, back = np.ones(1), np.array([-0.04])  # m/s
        >>> order = ot.LookAround(one > 0, back, 0 * one, one.astype(int), {}, {})
        >>> presser.odometry().look_around(ot.Actuation(np.zeros((1, 6))), order).ctrl.round(2)
        array([[-1.67, -1.67, -1.67, -1.67, -1.67, -1.67]])
    """

    robots: NDArray[np.bool_]
    speed: Array
    turn: Array
    gear: NDArray[np.int_]
    begun: Mapping[str, Array]
    readings: Mapping[str, Array]


class Odometry:
    """What the body of a kind of robot measures of its motion and of its pipe, for n robots.

    A robot states it by ``Robot.odometry`` and can then be driven by its own sensors alone
    (``sensing.kind = "onboard"``). ``surfaces``, ``angles``, ``arms`` and ``torques`` are functions
    of the physics, to which the errors of ``[sensing]`` are added; all other methods know the
    readings alone. Needed are ``surfaces``, ``surface_radius`` and ``look_around``.

    Args:
        robot: its parameters, shared by all n.

    Attributes:
        surface_radius: m, by which a driven surface moves on for each rad of its motor's shaft, on
            which the encoder sits.
        surface_period: m, after which a surface is the same again and its position may jump back;
            infinite where it goes on and on.
        roll_rate: rad/s, at which it turns its contacts about its axis while it stands, to see the
            pipe from another side; 0 where it cannot.

    Example:
        >>> import numpy as np
        >>> class Wheels(ot.Odometry):
        ...     surface_radius = 0.03  # m
        ...     def surfaces(self, state):
        ...         return self.surface_radius * state.qpos[:, -2:]  # two wheels
        ...     def look_around(self, command, order):
        ...         speed = (order.gear * order.speed)[:, None] / self.surface_radius
        ...         ctrl = np.where(order.robots[:, None], speed, command.ctrl)
        ...         return command._replace(ctrl=ctrl)
        >>> odometry, none = Wheels(ot.load_scenario("robots/presser_tee").robot), np.zeros((1, 0))
        >>> odometry.motion(ot.BodyReadings(np.array([[0.001, 0.003]]), none, none, none)).travel
        array([0.002])
    """

    surface_radius: float
    surface_period: float = math.inf
    roll_rate: float = 0.0

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    # Truth of what its sensors measure

    def surfaces(self, state: State) -> Array:
        """Return the positions (n, w) m of the surfaces that drive it along, such as its wheels'.

        Args:
            state: of the physics.
        """
        raise NotImplementedError("surfaces")

    def angles(self, state: State) -> Array:
        """Return the angles (n, a) rad of further joints with an encoder; by default none."""
        return np.zeros((len(state["time"]), 0))

    def arms(self, state: State) -> Array:
        """Return the places (n, b) m of limbs that are pressed to the wall; by default none."""
        return np.zeros((len(state["time"]), 0))

    def torques(self, state: State) -> Array:
        """Return the torques (n, m) N m of motors whose current is measured; by default none."""
        return np.zeros((len(state["time"]), 0))

    def velocity(self, state: State) -> Array:
        """Return the velocities (n, 3) m/s, world frame, of the inertial unit.

        By default they are those of the free joint.
        """
        return state.qvel.take(state.at.qvel[:3], axis=1)

    def torque_limit(self, robot: Robot) -> float:
        """Return the largest torque of these motors, N m, to which errors of the current refer.

        Args:
            robot: parameters of one of the n.
        """
        return 1.0

    # What the readings tell

    def motion(self, body: BodyReadings) -> Motion:
        """Return the motion over a control period; by default the mean of the surfaces' travel."""
        return Motion.along(body.travel.mean(axis=1))

    def limbs(self, body: BodyReadings) -> Limbs | None:
        """Return where its limbs may touch the wall; None: nothing is known of that."""
        return None

    def bore(self, body: BodyReadings) -> Array:
        """Return the bores (n,) m around the robots; by default not a number: nothing is known."""
        return np.full(len(body.travel), np.nan)

    def observed(self, body: BodyReadings, period: float) -> Mapping[str, Array]:
        """Return what controllers receive beside time, pose and angular velocity.

        The names are those of the robot's channels; by default there are none.

        Args:
            body: readings.
            period: s, over which they were taken.
        """
        return {}

    def to_controller(
        self, readings: Mapping[str, Array], gear: NDArray[np.int_], channels: Iterable[Channel]
    ) -> Mapping[str, Array]:
        """Return readings as controllers receive them; see ``Plant.to_controller``."""
        return readings

    @property
    def lens(self) -> float:
        """Distance, m, along its axis from its centre to the cameras; by default to nose and tail.

        The lens stands ahead of that by ``ahead`` of the camera's table.
        """
        return self.robot.length / 2

    def look_around(self, command: Any, order: LookAround) -> Any:
        """Return a command with that of robots that have lost their pose replaced.

        Args:
            command: of the controller; what it asks of the other robots stands.
            order: who is to stand, creep and roll.
        """
        raise NotImplementedError("look_around")


def odometry_of(robot: Robot) -> Odometry:
    """Return the odometry of a robot that is to drive by its own sensors.

    Raises:
        InputError: it states none.
    """
    odometry = robot.odometry()
    if odometry is None:
        problem = (
            f"is 'onboard', and a robot of kind {robot.kind!r} states no odometry: have its method "
            "odometry return an ot.Odometry (docs/how-to/autonomy.md)"
        )
        raise InputError(Fault("sensing.kind", problem, ("truth",)))
    problem = _lacks(odometry)
    if problem:
        raise InputError(Fault("robot", f"{problem} (docs/how-to/autonomy.md)"))
    return odometry


def _lacks(odometry: Any) -> str:
    """Return what a robot's odometry lacks, and what to write; "" where it has what is needed."""
    if isinstance(odometry, type):
        return f"odometry() returns the class {odometry.__name__}: write {odometry.__name__}(self)"
    name = type(odometry).__name__
    if not isinstance(odometry, Odometry):
        return f"odometry() returns a {name}, which does not inherit from ot.Odometry"
    radius = getattr(odometry, "surface_radius", None)
    if not (isinstance(radius, float | int) and 0 < radius < math.inf):
        has = "no surface_radius" if radius is None else f"surface_radius {shown(radius)}"
        return f"its odometry {name} has {has}: write surface_radius = 0.025, in m, for example"
    for method, arguments in (("surfaces", "state"), ("look_around", "command, order")):
        if getattr(type(odometry), method) is getattr(Odometry, method):
            return f"its odometry {name} has no {method}: write def {method}(self, {arguments})"
    return ""


def check_shapes(odometry: Odometry, state: State) -> None:
    """Refuse odometry that does not measure a row of values for each robot.

    Args:
        odometry: that is checked.
        state: of the physics at the start.

    Raises:
        InputError: at ``robot``.
    """
    n = len(state["time"])
    for name, shape in (
        ("surfaces", "w"),
        ("angles", "a"),
        ("arms", "b"),
        ("torques", "m"),
        ("velocity", "3"),
    ):
        has = np.shape(getattr(odometry, name)(state))
        right = len(has) == 2 and has[0] == n and (shape != "3" or has[1] == 3)
        if not right or (name == "surfaces" and has[1] == 0):
            problem = (
                f"its odometry {type(odometry).__name__} returns {name} of shape {has}, and needs "
                f"(n, {shape}), a row for each of the n robots, here {n}: index state.qpos[:, ...]"
            )
            raise InputError(Fault("robot", problem))
