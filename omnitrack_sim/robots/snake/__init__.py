"""A snake of eight links that climbs as a rolling helix."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, frame_of
from omnitrack_sim.base.table import NotNegative, Positive
from omnitrack_sim.robots.quantity import quantity
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.walls.geoms import new_spec

LINKS, CENTRE = 8, 4
"""Number of links, and the one, counted from the tail, that the others hang on."""
OUTWARDS = (*range(CENTRE + 1, LINKS), *range(CENTRE - 1, -1, -1))
"""The other links, each after the one that it hangs on."""
BEND = [-1.3, 1.3]
"""Range of a joint's angle about one axis, rad."""
LENGTH, RADIUS = 0.09, 0.022
"""Of a link, m: from joint to joint, and of its rubber."""
ACROSS = np.array([1.0, 0.0, 0.0])
"""Axis x of the middle link's frame: the link is square to it."""
SHELL = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": 2}
"""Attributes of geoms that are only drawn."""


class Snake(Robot):
    """A snake that presses itself against the wall as a helix, and rolls about its own length.

    Its joints lie on a helix, each by ``turn`` further about the pipe's axis. The joints want a
    helix that is wider than the bore by ``squeeze``, and so press it to the wall: stiffly and by
    little, as what is wider catches at the far edge of a branch. As every link turns about itself
    at ``rate``, the helix rolls forward at

        v = rate * a * sin(lean) * cos(turn / 2)

    with a = 22 mm and ``lean`` the angle between a link and the pipe's axis: a ball at a joint
    rolls about its link, which lies at 90 degrees - turn / 2 to the helix' radius there. It is held
    where the helix has about one and a half turns; with one and a quarter it falls.

    Example:
        >>> from omnitrack_sim.robots.snake import Snake
        >>> Snake().spec().compile().nu
        14
    """

    kind: ClassVar[str] = "snake"
    bore: Positive = quantity(0.16, "m", "assumed", "of the pipe that the helix is made for")
    friction: Positive = quantity(0.8, "1", "assumed", "of the rubber, where the walls state none")
    turn: Positive = quantity(
        1.2, "rad", "assumed", "from joint to joint: one and a half turns of eight links"
    )
    squeeze: NotNegative = quantity(
        0.1,
        "1",
        "assumed",
        "by which the commanded helix is wider than the bore allows, part of its radius",
    )
    stiffness: Positive = quantity(8.0, "N m/rad", "assumed", "of the joints' position loops")
    rate: float = quantity(2.5, "rad/s", "assumed", "of the links about themselves")

    def directions(self, squeeze: float = 0.0) -> Array:
        """Return unit vectors (8, 3) along the links, tail to head.

        The joints are on a helix about z that touches the bore, or is wider by ``squeeze``.
        """
        turn = self.turn / (1 + squeeze)
        across = 2 * (1 + squeeze) * (self.bore / 2 - RADIUS) * math.sin(turn / 2) / LENGTH
        angle = turn * (np.arange(LINKS) - CENTRE)
        along = np.full(LINKS, math.sqrt(1 - across**2))
        return np.stack([-across * np.sin(angle), across * np.cos(angle), along], axis=-1)

    def spec(self) -> mujoco.MjSpec:
        """Return the robot alone, in its helix about z: the origin is on the pipe's axis."""
        spec = new_spec("snake")
        spec.option.impratio = 100
        directions = self.directions()
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, frame_of(ACROSS, directions[CENTRE]).ravel())
        # The middle of a link lies further inside than its joints.
        inside = (self.bore / 2 - RADIUS) * math.cos(self.turn / 2)
        centre = spec.worldbody.add_body(name="chassis", pos=[inside, 0, 0], quat=quaternion)
        centre.add_freejoint()
        self._add_link(centre, CENTRE, 0.0)
        angles = joint_angles(directions, np.zeros(1))[0]
        end = {CENTRE: (centre, 0.0)}
        for k, (about_x, about_y) in zip(OUTWARDS, angles, strict=True):
            outwards = LENGTH if k > CENTRE else -LENGTH
            parent, middle = end[k - 1 if k > CENTRE else k + 1]
            cross = self._add_joint(
                spec, parent, f"x_{k}", [1, 0, 0], about_x, middle + outwards / 2
            )
            cross.add_geom(size=[0.6 * RADIUS, 0, 0], **SHELL | {"mass": 0.01})
            link = self._add_joint(spec, cross, f"y_{k}", [0, 1, 0], about_y, 0.0)
            self._add_link(link, k, outwards / 2)
            end[k] = link, outwards / 2
        for k, name in ((0, "tail"), (LINKS - 1, "nose")):
            link, middle = end[k]
            tip = middle + math.copysign(LENGTH / 2 + RADIUS, middle)
            link.add_site(name=name, group=4, pos=[0, 0, tip])
        lens = [0, 0, tip - 0.007]
        link.add_geom(size=[0.009, 0, 0], pos=lens, rgba=[0.5, 0.75, 0.9, 1], **SHELL)
        link.add_camera(name="eye", pos=[0, 0, tip], quat=[0, 1, 0, 0], fovy=90)
        return spec

    def _add_joint(
        self,
        spec: mujoco.MjSpec,
        parent: mujoco.MjsBody,
        name: str,
        axis: list[float],
        angle: float,
        at: float,
    ) -> mujoco.MjsBody:
        """Add a body with a hinge and its servo; it is bent by ``angle`` to begin with."""
        bend = [math.cos(angle / 2), *(math.sin(angle / 2) * np.array(axis))]
        body = parent.add_body(name=name, pos=[0, 0, at], quat=bend)
        # Being bent is no other zero: angles count from the straight snake.
        hinge = {"ref": angle, "range": BEND, "armature": 0.005}
        body.add_joint(name=name, axis=axis, **hinge).damping[0] = 0.02
        limits = {"forcerange": [-1.5, 1.5], "ctrlrange": BEND}
        servo = spec.add_actuator(name=name, target=name, **limits)
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=self.stiffness, kv=0.1)
        return body

    def _add_link(self, body: mujoco.MjsBody, k: int, middle: float) -> None:
        """Draw and weigh link ``k``: a rubber capsule with a band, of the size of two servos."""
        capsule, cylinder = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
        # Links touch walls only: their round ends lie one in the other.
        body.add_geom(
            name=f"link_{k}",
            type=capsule,
            size=[RADIUS, LENGTH / 2, 0],
            pos=[0, 0, middle],
            mass=0.14,
            friction=[self.friction, 0.005, 0.0001],
            solref=[0.005, 1],
            contype=0,
            rgba=[0.2, 0.22, 0.24, 1],
        )
        band = {"type": cylinder, "rgba": [0.93, 0.48, 0.11, 1], **SHELL}
        for offset, half in ((0.0, 0.008), (0.022, 0.002), (-0.022, 0.002)):
            size = [1.01 * RADIUS, half, 0]
            body.add_geom(size=size, pos=[0, 0, middle + offset], **band)

    @property
    def ends(self) -> tuple[str, str]:
        """See ``Robot``: links wind round the way."""
        return self.nose, self.tail

    @property
    def start_ctrl(self) -> Array:
        """See ``Robot``: the helix presses against the wall."""
        return joint_angles(self.directions(self.squeeze), np.zeros(1)).ravel()

    def gait(self, observation: Any) -> Array:
        """See ``Robot``: angles (n, 14) rad of a helix whose links turn about themselves."""
        n = len(observation.qpos)
        roll = np.broadcast_to(self.rate * np.asarray(observation.time), n)
        return joint_angles(self.directions(self.squeeze), roll).reshape(n, -1)


def joint_angles(directions: Array, roll: Array) -> Array:
    """Return the angles (n, 7, 2) rad of the universal joints that lay links along directions.

    Each joint turns a link about x, then about y of the one that it hangs on; ``OUTWARDS`` is
    their order.

    Args:
        directions: (8, 3) unit vectors along the links.
        roll: (n,) rad, by which the centre link is turned about itself.
    """
    cos, sin, zero = np.cos(roll), np.sin(roll), np.zeros(len(roll))
    turned = np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, zero + 1]])
    frames = {
        CENTRE: frame_of(ACROSS, directions[CENTRE]) @ np.moveaxis(turned, -1, 0)
    }  # (n, 3, 3)
    angles = []
    for k in OUTWARDS:
        frame = frames[k - 1 if k > CENTRE else k + 1]
        x, y, z = (directions[k] @ frame).T
        about_x, about_y = np.arctan2(-y, z), np.arcsin(x)
        ca, sa, cb, sb = np.cos(about_x), np.sin(about_x), np.cos(about_y), np.sin(about_y)
        bend = np.array([[cb, zero, sb], [sa * sb, ca, -sa * cb], [-ca * sb, sa, ca * cb]])
        frames[k] = frame @ np.moveaxis(bend, -1, 0)
        angles.append(np.stack([about_x, about_y], axis=-1))
    return np.stack(angles, axis=1)
