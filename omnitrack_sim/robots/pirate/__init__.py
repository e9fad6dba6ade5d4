"""PIRATE, a planar chain of the University of Twente that clamps itself between opposite walls."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, Pose, dot, wrap_angle
from omnitrack_sim.base.table import Positive
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.robots.control import Actuation, Controller, ControlSetup, Observation
from omnitrack_sim.robots.quantity import quantity
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.walls.geoms import new_spec

SIDES = np.array([-1, 1, -1, -1, 1, -1])
"""Side of the pipe at which each wheel runs, tail to nose: towards the robot's x axis or away."""
REAR, FRONT = 2, 3
"""Wheels at the ends of the middle link, of ``SIDES``."""
BENDS = ("bend_1", "bend_2", "bend_3", "bend_4")
"""Bending joints, tail to nose; the first and the last are the apexes of the clamps."""
CABLE = "Maks, BSc report, University of Twente 2015, summary"


class Pirate(Robot):
    """Five links in one plane, a driven wheel at every node, a roll joint in the middle link.

    Its two ends are bent to a V each, which presses its three wheels to opposite walls. A clamping
    torque T at the apex of two links of length L that lie at the angle a to the pipe presses with

        N = T / (L cos a)

    at its ends and 2 N at the apex, so that both clamps hold and pull ``8 * friction * N``.

    Example:
        >>> from omnitrack_sim.robots.pirate import Pirate
        >>> f"{Pirate().slope:.2f} rad, pull {Pirate().pull(0.8):.1f} N"
        '0.70 rad, pull 9.2 N'
    """

    bore: Positive = quantity(0.1, "m", "assumed", "of the pipe that it is clamped in at the start")
    min_bore: Positive = quantity(0.051, "m", "published", CABLE)
    max_bore: Positive = quantity(0.12, "m", "published", CABLE)
    speed: Positive = quantity(0.08, "m/s", "published", f"of the wheels without load; {CABLE}")
    link: Positive = quantity(
        0.085, "m", "assumed", "from node to node: spans the largest bore at 62 degrees"
    )
    wheel_radius: Positive = quantity(0.0225, "m", "assumed", "two of them fit the smallest bore")
    wheel_width: Positive = quantity(0.01, "m", "assumed", "of a tyre")
    wheel_mass: Positive = quantity(0.02, "kg", "assumed", "of a wheel")
    link_mass: Positive = quantity(0.09, "kg", "assumed", "of a link with its motors")
    link_radius: Positive = quantity(0.012, "m", "assumed", "of a link's body")
    clamp_torque: Positive = quantity(
        0.44, "N m", "inferred", "so that it pulls the published 14 N at friction 0.8 on the level"
    )
    joint_stiffness: Positive = quantity(1.0, "N m/rad", "assumed", "of the bending joints' servos")
    joint_damping: Positive = quantity(0.03, "N m s/rad", "assumed", "of these")
    joint_torque: Positive = quantity(1.5, "N m", "assumed", "limit of a bending joint")
    roll_stiffness: Positive = quantity(3.0, "N m/rad", "assumed", "of the roll joint's servo")
    motor_gain: Positive = quantity(
        0.05, "N m s/rad", "assumed", "of a wheel's motor: stall torque over no-load speed"
    )
    torque_limit: Positive = quantity(0.15, "N m", "assumed", "of a wheel's motor")
    friction: Positive = quantity(0.8, "1", "assumed", "of the tyres, where the walls state none")

    kind: ClassVar[str] = "pirate"

    @classmethod
    def controllers(cls) -> Mapping[str, type[Controller]]:
        """See ``Robot``."""
        return {"shape": Shape, **super().controllers()}

    @property
    def bores(self) -> tuple[float, float]:
        """See ``Robot``: the published ones."""
        return 0.999 * self.min_bore, 1.001 * self.max_bore

    @property
    def nominal_speed(self) -> float:
        """See ``Robot``."""
        return self.speed

    @property
    def reach(self) -> float:
        """Distance of the wheels' centres from the pipe's axis, m."""
        # A tyre of finite width touches the bore with its two edges.
        return math.sqrt(self.bore**2 - self.wheel_width**2) / 2 - self.wheel_radius

    @property
    def slope(self) -> float:
        """Angle of the clamps' links to the pipe, rad."""
        return math.asin(2 * self.reach / self.link)

    def pull(self, friction: float) -> float:
        """Return the force, N, that both clamps hold along the pipe, without the robot's weight."""
        return 8 * friction * self.clamp_torque / (self.link * math.cos(self.slope))

    @property
    def frame(self) -> Pose:
        """See ``Robot``: the middle link runs along the wall."""
        return Pose(np.eye(3), np.array([self.reach, 0.0, 0.0]))

    def spec(self) -> mujoco.MjSpec:
        """Return the robot alone, clamped along z in its plane of x and z."""
        spec = new_spec("pirate")
        spec.option.impratio = 100
        half = self.link / 2
        middle = spec.worldbody.add_body(name="chassis", pos=[-self.reach, 0, 0])
        middle.add_freejoint()
        self._add_link(middle, [0, 0, -half], [0, 0, 0], 0.5)
        turret = middle.add_body(name="turret")
        turret.add_joint(name="roll", axis=[0, 0, 1], armature=1e-3, damping=[0.02, 0, 0])
        self._add_servo(spec, "roll", self.roll_stiffness)
        self._add_link(turret, [0, 0, 0], [0, 0, half], 0.5)
        bends = self.bends(self.slope)
        for root, node, names, way in (
            (middle, REAR, BENDS[1::-1], -1),
            (turret, FRONT, BENDS[2:], 1),
        ):
            link, at = root, half
            self._add_wheel(spec, link, node, [0, 0, way * at])
            for k, name in enumerate(names):
                angle = bends[BENDS.index(name)]
                turn = [math.cos(angle / 2), 0, math.sin(angle / 2), 0]
                link = link.add_body(name=name, pos=[0, 0, way * at], quat=turn)
                # Being bent is no other zero: angles count from the straight chain.
                hinge = link.add_joint(name=name, axis=[0, 1, 0], ref=angle, armature=1e-3)
                hinge.damping[0], hinge.range = 0.005, [-2.2, 2.2]
                self._add_servo(spec, name, self.joint_stiffness)
                at = self.link
                self._add_link(link, [0, 0, 0], [0, 0, way * at], 1.0)
                self._add_wheel(spec, link, node + way * (k + 1), [0, 0, way * at])
            end = "nose" if way > 0 else "tail"
            link.add_site(name=end, group=4, pos=[0, 0, way * (at + self.wheel_radius)])
        link.add_camera(name="eye", pos=[0, 0, at + self.wheel_radius], quat=[0, 1, 0, 0], fovy=90)
        return spec

    def _add_servo(self, spec: mujoco.MjSpec, name: str, stiffness: float) -> None:
        """Add a position servo to a joint."""
        limit = [-self.joint_torque, self.joint_torque]
        # Wider than the joints reach: what is asked for beyond the wall presses.
        asked = [-math.pi, math.pi]
        servo = spec.add_actuator(name=name, target=name, forcerange=limit, ctrlrange=asked)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=stiffness, kv=self.joint_damping)

    def _add_link(self, body: mujoco.MjsBody, start: list, end: list, part: float) -> None:
        """Draw and weigh a link, or a part of one."""
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[self.link_radius, 0, 0],
            fromto=[*start, *end],
            mass=part * self.link_mass,
            friction=[0.2, 0.005, 0.0001],  # smooth plastic that slides on edges
            contype=0,
            rgba=[0.93, 0.48, 0.11, 1] if part < 1 else [0.2, 0.24, 0.3, 1],
        )

    def _add_wheel(self, spec: mujoco.MjSpec, body: mujoco.MjsBody, k: int, pos: list) -> None:
        """Add a driven wheel at node ``k``."""
        wheel = body.add_body(name=f"wheel_{k}", pos=pos)
        wheel.add_joint(name=f"wheel_{k}", axis=[0, 1, 0], armature=1e-4)
        width = self.wheel_width / 2
        wheel.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[self.wheel_radius, 0, 0],
            fromto=[0, -width, 0, 0, width, 0],
            mass=self.wheel_mass,
            friction=[self.friction, 0.005, 0.0001],
            solref=[0.005, 1],
            contype=0,
            rgba=[0.12, 0.12, 0.13, 1],
        )
        hub = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": 2}
        wheel.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[0.6 * self.wheel_radius, 0, 0],
            fromto=[0, -1.1 * width, 0, 0, 1.1 * width, 0],
            rgba=[0.8, 0.81, 0.83, 1],
            **hub,
        )
        fastest = self.speed / self.wheel_radius
        names = {"name": f"wheel_{k}", "target": f"wheel_{k}"}
        motor = spec.add_actuator(ctrlrange=[-fastest, fastest], **names)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.set_to_velocity(kv=self.motor_gain)
        motor.forcerange = [-self.torque_limit, self.torque_limit]

    def bends(self, slope: float) -> Array:
        """Return the bending joints' angles (4,) rad in a straight at a slope of the links, rad."""
        return slope * np.array([2.0, -1.0, 1.0, -2.0])

    def inputs(self, bends: Array, roll: Array, wheels: Array, grip: Array) -> Array:
        """Return control inputs (n, 11), in the model's order of actuators.

        Args:
            bends: (n, 4) rad.
            roll: (n,) rad.
            wheels: (n, 6) speeds of the tyres forward along the wall, m/s.
            grip: (n, 2) parts of the clamping torque with which the rear and the front press.
        """
        # A servo that is asked for more than the wall allows presses with what it lacks.
        press = self.clamp_torque / self.joint_stiffness * np.array([1.0, 0.0, 0.0, -1.0])
        turns = SIDES * wheels / self.wheel_radius
        joints = bends + press * np.repeat(grip, 2, axis=1)
        return np.stack(
            [
                roll,
                *(turns[:, 2], joints[:, 1], turns[:, 1], joints[:, 0], turns[:, 0]),
                *(turns[:, 3], joints[:, 2], turns[:, 4], joints[:, 3], turns[:, 5]),
            ],
            axis=-1,
        )

    @property
    def start_ctrl(self) -> Array:
        """See ``Robot``: both ends are clamped."""
        bends = self.bends(self.slope)[None]
        return self.inputs(bends, np.zeros(1), np.zeros((1, 6)), np.ones((1, 2)))[0]


@dataclass(frozen=True)
class ShapeSettings:
    """Shape of the chain at branches, where a wall is missing, and turns about the pipe's axis.

    Attributes:
        min_spread: part of their distance from the centreline at which nodes are beside a branch;
            of 12 random turns 8 pass, with 0.25 7; of other 8 with 0.5 and a ramp of half a bore 1.
        ramp: bores before and behind a tee over which it falls to that; with 0.5 of 8 turns into a
            branch 4 pass, with 1 bore 1.
        iterations: of the arc length at which a link ends; it is off by 1.2 mm at most then, in a
            tee.
        off: rad, by which its plane may lie beside that of the bend: it passes with 30 degrees.
        twist: rad, of the roll joint at most in each cycle; with 0.5 a turn takes twice as long.
        half_cycle: s, for which one end turns, then the other.
        loose: part of its clamping torque at which an end turns: it must be much weaker than the
            one that holds, and 0.2 turns half as far.
        creep: m/s, at which it goes on meanwhile, so that a watch does not take it for stuck.
        hold_time: s, in which its wheels make up for what it slid.
    """

    min_spread: float = 0.1
    ramp: float = 0.25
    iterations: int = 4
    off: float = 0.15
    twist: float = 0.8
    half_cycle: float = 0.5
    loose: float = 0.05
    creep: float = 0.004
    hold_time: float = 0.2


SETTINGS = ShapeSettings()


class Shape:
    """Joint angles and wheel speeds that lay the chain along its route.

    Each node is wanted at its side of the pipe, at the same distance from the centreline in bends
    as in straights; angles of the joints are those between the links, seen in the robot's plane.

    Before a bend the chain turns itself into its plane: one end is loosened, and the roll joint
    turns it against the other, which holds; then that one follows.
    """

    def __init__(self, setup: ControlSetup) -> None:
        self._robot: Pirate = setup.robot
        self._routes, self._period = setup.routes, setup.period
        self._ends = self._robot.length / 2 * np.array([-1.0, 0.0, 1.0])  # tail to nose, m
        self._twist, self._hold = np.zeros(setup.n), np.zeros(setup.n)
        self._count = np.zeros(setup.n, np.intp)  # steps since the turn began

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:  # noqa: ARG002 - protocol
        """Begin anew for robots ``rows`` (k,)."""
        self._twist[rows] = 0.0

    def step(self, observation: Observation) -> Actuation:
        """Return the inputs of all joints and wheels, by where the robots are."""
        robot, place = self._robot, observation.location
        nodes, ratios = chain(robot, self._routes, place)
        roll, grip = self._turn(place)
        # A robot that turns stays about where it is, as one end alone slides by its weight.
        way = self._hold + SETTINGS.creep * self._period * self._count - place.distance
        back = np.clip(way / SETTINGS.hold_time, -robot.speed, robot.speed)
        speed = np.where(self._twist == 0, robot.speed, back)
        wheels = speed[:, None] * ratios / ratios.max(axis=1, keepdims=True)
        return Actuation(robot.inputs(bending(nodes), roll, wheels, grip))

    def _turn(self, place: Location) -> tuple[Array, Array]:
        """Return the angles (n,) rad of roll joints, and the grip (n, 2) of rear and front."""
        half, grip = round(SETTINGS.half_cycle / self._period), np.ones((len(self._count), 2))
        self._count += 1
        between = (self._twist == 0) | (self._count % (2 * half) == 0)
        twist = np.where(between, self._twist_due(place), self._twist)
        begins = (self._twist == 0) & (twist != 0)
        self._count[begins], self._hold[begins] = 0, place.distance[begins]
        self._twist = twist
        part = self._count % (2 * half) / half
        turns, front = twist != 0, part < 1
        grip[turns & front, 1] = grip[turns & ~front, 0] = SETTINGS.loose
        return twist * np.minimum(part, 2 - part), grip

    def _twist_due(self, place: Location) -> Array:
        """Angles (n,) rad by which fronts are to turn now.

        Those turn that lie in a straight, off the plane of the bend ahead.
        """
        robot, routes = self._robot, self._routes
        due = routes.is_turn[place.passage] & (np.abs(place.theta5) > SETTINGS.off)
        if not due.any():
            return np.zeros(len(due))
        along = place.distance[:, None] + self._ends
        tangents = routes.tangents(along, place.route)
        walls = np.min([wall_closeness(robot, routes, s, place.route) for s in along.T], axis=0)
        is_straight = dot(tangents[:, 0], tangents[:, 2]) > 1 - 1e-9
        twist = np.clip(-place.theta5, -SETTINGS.twist, SETTINGS.twist)
        return np.where(due & is_straight & (walls > SETTINGS.min_spread), twist, 0.0)


def chain(robot: Pirate, routes: RouteMap, place: Location) -> tuple[Array, Array]:
    """Return set points of the nodes: positions (n, 6, 3) m in the world, and speed ratios (n, 6).

    The ratios are of the speeds of their wheels over that of the robot.
    """
    line, n = routes.centreline, len(place.route)
    middle = line.frame(place.distance, place.route)
    x = place.frame[:, :, 0]
    # In the frame that the centreline carries along without twist; rear, then front.
    roll = np.tile(np.arctan2(dot(x, middle[:, :, 1]), dot(x, middle[:, :, 0])), 2)[:, None]
    along_x, along_y = np.cos(roll), np.sin(roll)
    route, way = np.tile(place.route, 2), np.repeat([-1.0, 1.0], n)

    def node(s: Array, side: int) -> tuple[Array, Array]:
        """Where nodes of a side are wanted, and the speeds of their wheels."""
        (point, _, normal, curvature), frame = line.at_with_frame(s, route)
        out = along_x * frame[:, :, 0] + along_y * frame[:, :, 1]
        out = (side * robot.reach * wall_closeness(robot, routes, s, route))[:, None] * out
        return point + out, 1 - curvature * dot(out, normal)

    s = np.tile(place.distance, 2) + way * robot.link / 2
    places = [node(s, SIDES[FRONT])]
    for side in SIDES[FRONT + 1 :]:
        step = np.full(2 * n, robot.link * math.cos(robot.slope))
        there = node(s + way * step, side)
        for _ in range(SETTINGS.iterations):
            away = np.linalg.norm(there[0] - places[-1][0], axis=1)
            better = np.clip(step * robot.link / away, 0.2 * robot.link, 2.5 * robot.link)
            if np.array_equal(better, step):
                break
            step = better
            there = node(s + way * step, side)
        s = s + way * step
        places.append(there)
    points, ratios = zip(*places, strict=True)
    rear, front = np.stack(points).reshape(3, 2, n, 3).swapaxes(0, 1)
    nodes = np.concatenate([rear[::-1], front]).swapaxes(0, 1)
    slow, fast = np.stack(ratios).reshape(3, 2, n).swapaxes(0, 1)
    return nodes, np.concatenate([slow[::-1], fast]).T


def wall_closeness(robot: Pirate, routes: RouteMap, s: Array, route: NDArray[np.intp]) -> Array:
    """Return how near to the wall (n,) nodes at arc lengths (n,) m are to be.

    1 where there is a wall on both sides, less over the opening of a branch.
    """
    openings = routes.is_tee_turn | routes.is_straight_over | routes.out_of_branch
    if not openings.any():
        return np.ones(len(s))
    mine = openings & (routes.route_of == route[:, None])  # (n, Q)
    away = np.maximum(routes.start - s[:, None], s[:, None] - routes.end)
    nearest = np.where(mine, away, np.inf).min(axis=1)
    return np.clip(nearest / (SETTINGS.ramp * robot.bore), SETTINGS.min_spread, 1.0)


def bending(nodes: Array) -> Array:
    """Return the angles (n, 4) rad of the bending joints that lead through nodes (n, 6, 3).

    They are seen in the plane of the middle link and the apexes of the clamps.
    """
    links = np.diff(nodes, axis=1)  # (n, 5, 3) tail to nose
    z = links[:, REAR] / np.linalg.norm(links[:, REAR], axis=1)[:, None]
    x = links[:, REAR + 1] - links[:, REAR - 1]
    x = x - dot(x, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1)[:, None]
    angles = np.arctan2((links @ x[:, :, None])[..., 0], (links @ z[:, :, None])[..., 0])
    # Of the rear each link hangs on the one ahead of it.
    turns = np.diff(angles, axis=1) * np.array([-1, -1, 1, 1])
    return wrap_angle(turns)
