"""A snake of sixteen alternating hinges, as Carnegie Mellon's, that rolls as a helix."""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, rotation_about
from omnitrack_sim.base.table import NotNegative, Positive
from omnitrack_sim.robots.quantity import quantity
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.walls.geoms import new_spec

JOINTS, CENTRE = 16, 8
"""Number of joints, and the link, counted from the tail, that carries the robot's free joint."""
AXES = np.eye(3)[[k % 2 for k in range(JOINTS)]]
"""Axes (16, 3) of the joints in the frame of the link behind, tail to head: x and y in turn."""
TOUCHING = 5
"""Number of joints that touch the wall, of a helix of one and a half turns in zigzag."""
REACH = 1.57
"""Of a joint, both ways, rad: "180 degrees of rotation", the lab's page on its modules."""
LAB = "website of CMU's Biorobotics Lab"
UNREAD = "from memory of the lab's publications, not checked"


class Coil(NamedTuple):
    """A cylinder about the joints of a snake.

    Attributes:
        axis: (3,) unit vector, tail to head.
        point: (3,) m, on it.
        zigzag: m, by which joints lie inside and outside of their mean distance from it.
        outer: m, mean distance of the joints that touch the wall, those farthest out.
        rise: m/rad, of the helix along its axis.
    """

    axis: Array
    point: Array
    zigzag: float
    outer: float
    rise: float


class Helix(Robot):
    """A snake of one hinge a module, whose axes alternate, in a helix that rolls about itself.

    Its joints follow the compound serpenoid

        even: A sin(nu k - w t),    odd: -A cos(nu k - w t)

    whose curvature turns about the snake by ``nu`` a module, which makes a helix, and with time,
    which makes every module turn about itself at w. The helix rolls along the pipe at

        v = w (a + d) cos(lead),    lead: angle between the snake and the circumference

    with a the modules' radius and d the amplitude of the zigzag in which joints of alternating axes
    lie about a helix, to some 10 %; ``advance`` is exact. It presses itself to the wall as the
    commanded helix is wider than the bore.

    Example:
        >>> from omnitrack_sim.robots.helix import Helix
        >>> Helix().spec().compile().nu
        16
    """

    bore: Positive = quantity(0.16, "m", "assumed", "of the pipe that its start is made for")
    module: Positive = quantity(
        0.0508,
        "m",
        "inferred",
        "from joint to joint, 2 in; a public model of its successor (snakelib, REU) has 50.6 mm",
    )
    radius: Positive = quantity(
        0.0254, "m", "published", f"of a module: two-inch diameter profile; {LAB}, SEA-snake"
    )
    mass_of_module: Positive = quantity(0.16, "kg", "inferred", UNREAD)
    amplitude: Positive = quantity(0.85, "rad", "assumed", "A of the joints")
    twist: Positive = quantity(0.5, "rad", "assumed", "nu of the start, which fits the bore")
    squeeze: NotNegative = quantity(
        0.05, "rad", "assumed", "by which nu is less in the gait, so that the helix is wider"
    )
    rate: float = quantity(
        2.0,
        "rad/s",
        "inferred",
        "w of the gait: rolling_helix of a public copy of the lab's snakelib",
    )
    stiffness: Positive = quantity(8.0, "N m/rad", "assumed", "of the joints' servos")
    torque_limit: Positive = quantity(
        3.0, "N m", "inferred", f"of a joint: peaks of over 2.7 N m; {LAB}, series elasticity"
    )
    friction: Positive = quantity(0.8, "1", "assumed", "of the skin, where the walls state none")

    kind: ClassVar[str] = "helix"

    def angles(self, phase: Any, twist: float) -> Array:
        """Return the joints' angles (..., 16) rad at phases (...) rad of the gait."""
        psi = twist * np.arange(JOINTS) - np.asarray(phase, float)[..., None]
        even = np.arange(JOINTS) % 2 == 0
        return self.amplitude * np.where(even, np.sin(psi), -np.cos(psi))

    def coil(self, angles: Array) -> Coil:
        """Return the cylinder about the joints of a snake that is bent by ``angles`` (16,) rad.

        It is in the frame of the last link, and needs joint angles alone.
        """
        return coil_of(self._links(angles)[0][1:-1])

    def pipe_bore(self, coil: Coil) -> float:
        """Return the inner diameter, m, of the pipe that a snake lies in."""
        return 2 * (coil.outer + self.radius)

    def rolling_speed(self, coil: Coil) -> float:
        """Return the speed along the pipe, m/s, at which the gait rolls as a smooth helix would."""
        cosine = coil.outer / math.hypot(coil.outer, coil.rise)
        return self.rate * (self.radius + coil.zigzag) * cosine

    def advance(self, before: Array, after: Array) -> float:
        """Return the way along the pipe, m, that a snake rolls between two moments without slip.

        The moments are given by joint angles (16,) rad. The snake is treated as a wheeled robot,
        whose wheels are the modules that touch: their material points at the wall stay where they
        are, so the snake moves by what these move back in it.
        """
        here, there = self._links(before), self._links(after)
        coils = [coil_of(ends[1:-1]) for ends, _ in (here, there)]
        offset = here[0][1:-1] - coils[0].point
        out = offset - np.outer(offset @ coils[0].axis, coils[0].axis)
        radii = np.linalg.norm(out, axis=1)
        # Along the axis of the helix from the mean of all joints, of both links at a joint.
        means = [
            coil.axis @ ends[1:-1].mean(axis=0)
            for (ends, _), coil in zip((here, there), coils, strict=True)
        ]
        ways = []
        for k in np.argsort(radii)[-TOUCHING:]:
            touch = self.radius * out[k] / radii[k]
            start = coils[0].axis @ (here[0][k + 1] + touch) - means[0]
            for link in (k, k + 1):
                moved = there[1][link] @ here[1][link].T @ touch
                ways.append(coils[1].axis @ (there[0][k + 1] + moved) - means[1] - start)
        return -float(np.mean(ways))

    def _links(self, angles: Array) -> tuple[Array, list[Array]]:
        """Ends (18, 3) m and frames of the links of a snake, tail to head."""
        frame, ends, frames = np.eye(3), [np.zeros(3)], []
        for axis, angle in zip((None, *AXES), (0.0, *angles), strict=True):
            frame = frame if axis is None else frame @ rotation_about(axis, angle)
            frames.append(frame)
            ends.append(ends[-1] + self.module * frame[:, 2])
        return np.array(ends), frames

    def spec(self) -> mujoco.MjSpec:
        """Return the robot alone, in its helix about z: the origin is on the pipe's axis."""
        spec = new_spec("helix")
        spec.option.impratio = 100
        angles = self.angles(0.0, self.twist)
        ends, frames = self._links(angles)
        coil = coil_of(ends[1:-1])
        upright = _upright(coil.axis)
        along = (ends[[0, -1]] - coil.point) @ coil.axis
        origin = coil.point + along.mean() * coil.axis
        middle = (ends[CENTRE] + ends[CENTRE + 1]) / 2
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, (upright @ frames[CENTRE]).ravel())
        chassis = spec.worldbody.add_body(
            name="chassis", pos=upright @ (middle - origin), quat=quaternion
        )
        chassis.add_freejoint()
        self._add_module(chassis, CENTRE, 0.0)
        for way, order in ((1, range(CENTRE, JOINTS)), (-1, range(CENTRE - 1, -1, -1))):
            body, at = chassis, way * self.module / 2
            for k in order:
                # Behind the chassis a joint turns the link behind it, so the other way.
                axis, half = way * AXES[k], angles[k] / 2
                turn = [math.cos(half), *(math.sin(half) * axis)]
                body = body.add_body(name=f"module_{k}", pos=[0, 0, at], quat=turn)
                # Being bent is no other zero: angles count from the straight snake.
                hinge = {"ref": angles[k], "range": [-REACH, REACH], "armature": 0.005}
                body.add_joint(name=f"joint_{k}", axis=axis, **hinge).damping[0] = 0.02
                at = way * self.module
                self._add_module(body, k + (way > 0), at / 2)
            end = "nose" if way > 0 else "tail"
            body.add_site(name=end, group=4, pos=[0, 0, at + way * self.radius])
        body = spec.body(f"module_{JOINTS - 1}")
        tip = [0, 0, self.module + self.radius]
        body.add_camera(name="eye", pos=tip, quat=[0, 1, 0, 0], fovy=90)
        for k in range(JOINTS):
            self._add_servo(spec, f"joint_{k}")
        return spec

    def _add_servo(self, spec: mujoco.MjSpec, name: str) -> None:
        """Add a position servo to a joint."""
        limit = [-self.torque_limit, self.torque_limit]
        reach = [-REACH, REACH]
        servo = spec.add_actuator(name=name, target=name, forcerange=limit, ctrlrange=reach)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=self.stiffness, kv=0.1)

    def _add_module(self, body: mujoco.MjsBody, k: int, middle: float) -> None:
        """Draw and weigh link ``k``, whose round ends lie one in the other."""
        body.add_geom(
            name=f"link_{k}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[self.radius, self.module / 2, 0],
            pos=[0, 0, middle],
            mass=self.mass_of_module,
            friction=[self.friction, 0.005, 0.0001],
            solref=[0.005, 1],
            contype=0,
            rgba=[0.2, 0.22, 0.24, 1],
        )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[1.01 * self.radius, 0.006, 0],
            pos=[0, 0, middle],
            contype=0,
            conaffinity=0,
            mass=0.0,
            group=2,
            rgba=[0.93, 0.48, 0.11, 1] if k % 2 else [0.55, 0.57, 0.6, 1],
        )

    @property
    def ends(self) -> tuple[str, str]:
        """See ``Robot``: modules wind round the way."""
        return self.nose, self.tail

    @property
    def start_ctrl(self) -> Array:
        """See ``Robot``: the helix presses against the wall."""
        return self.angles(0.0, self.twist - self.squeeze)

    def gait(self, observation: Any) -> Array:
        """See ``Robot``: the compound serpenoid, whose phase grows with time."""
        time = np.broadcast_to(np.asarray(observation.time), len(observation.qpos))
        return self.angles(self.rate * time, self.twist - self.squeeze)


def coil_of(points: Array) -> Coil:
    """Return the cylinder that lies nearest to points (n, 3) of a helix, in order along it.

    The axis begins as the direction in which the smoothed points do not curve, and is then found
    by least squares (Gauss-Newton), as the joints of alternating axes lie in zigzag about a helix.
    """
    smooth = (points[:-2] + 2 * points[1:-1] + points[2:]) / 4
    curve = smooth[4:] - 2 * smooth[2:-2] + smooth[:-4]
    axis = np.linalg.svd(curve)[2][2]
    axis *= np.sign(axis @ (points[-1] - points[0]))
    point = points.mean(axis=0)
    for _ in range(20):
        across = _upright(axis)[:2].T
        offset, along = (points - point) @ across, (points - point) @ axis
        radii = np.linalg.norm(offset, axis=1)
        out = offset / radii[:, None]
        jacobian = np.column_stack([-out, -out * along[:, None], -np.ones(len(points))])
        step = np.linalg.lstsq(jacobian, radii.mean() - radii, rcond=None)[0]
        point, axis = point + across @ step[:2], axis + across @ step[2:4]
        axis /= np.linalg.norm(axis)
    place = (points - point) @ _upright(axis).T
    radii = np.hypot(place[:, 0], place[:, 1])
    turn = np.unwrap(np.arctan2(place[:, 1], place[:, 0]))
    rise = abs(np.polyfit(turn, place[:, 2], 1)[0])
    outer = np.sort(radii)[-TOUCHING:].mean()
    return Coil(axis, point, float(np.ptp(radii) / 2), float(outer), float(rise))


def _upright(axis: Array) -> Array:
    """Rotation (3, 3) that turns a unit vector (3,) to z."""
    side = np.eye(3)[np.abs(axis).argmin()]
    x = np.cross(side, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis])
