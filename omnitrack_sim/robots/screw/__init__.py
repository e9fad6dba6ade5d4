"""A screw drive: tilted wheels of a rotor climb a helix, those of a stator keep it from turning."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

import mujoco
import numpy as np
from pydantic import Field

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Positive
from omnitrack_sim.robots.quantity import quantity
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.walls.geoms import new_spec

ARMS = 3
"""Of the stator, and of the rotor."""
POLOLU = "Pololu 1000:1 HPCB 12 V, figures of the maker for other ratios, scaled"
RAMP = 0.5
"""Time, s, in which the rotor reaches its speed, so that the start asks for little torque."""
CYLINDER, CAPSULE = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE
SHELL = {"contype": 0, "conaffinity": 0, "group": 2}
"""Attributes of geoms that touch nothing."""
GREY, DARK, ORANGE = [0.72, 0.74, 0.77, 1], [0.12, 0.12, 0.13, 1], [0.93, 0.48, 0.11, 1]


class Screw(Robot):
    """A screw drive: one motor between a stator and a rotor, whose wheels are passive.

    The rotor's wheels are tilted by ``lead`` against the pipe's cross section and roll along a
    helix; the stator's roll along the pipe and keep it from turning. Without load

        v = omega R tan(lead),    R: radius of the bore

    As passive wheels pass on forces along their axles alone, a pull F asks for the torque
    T = F R tan(lead), so that T omega = F v. The rotor slips from F = 3 N mu cos(lead) on, with N
    for ``rotor_preload``; the stator turns from F = 3 P mu / tan(lead) on, with P for
    ``stator_preload``.

    Example:
        >>> from omnitrack_sim.robots.screw import Screw
        >>> screw = Screw(lead=0.2)
        >>> f"{1e3 * screw.speed_at(3.0):.1f} mm/s"
        '48.7 mm/s'
    """

    bore: Positive = quantity(0.16, "m", "assumed", "of the pipe that its arms are set for")
    lead: Annotated[float, Field(gt=0, lt=1.2)] = quantity(
        0.175, "rad", "assumed", "angle of the rotor's helix, 10 degrees"
    )
    friction: Positive = quantity(
        0.8, "1", "assumed", "of the tyres, rubber on a dry pipe, where the walls state none"
    )
    rotor_preload: Positive = quantity(25.0, "N", "assumed", "of each of the rotor's springs")
    stator_preload: Positive = quantity(
        15.0, "N", "assumed", "of each of the stator's springs, which press two wheels"
    )
    stiffness: Positive = quantity(2000.0, "N/m", "assumed", "of an arm's spring")
    damping: Positive = quantity(20.0, "N s/m", "assumed", "of an arm's guide rods")
    travel_in: Positive = quantity(0.009, "m", "assumed", "of an arm towards the axis")
    travel_out: Positive = quantity(0.008, "m", "assumed", "of an arm beyond the wall")
    wheel_radius: Positive = quantity(0.016, "m", "assumed", "of the tyres")
    tyre_width: Positive = quantity(0.012, "m", "assumed", "of the tyres, which are round")
    wheelbase: Positive = quantity(0.06, "m", "assumed", "between the stator's rings of wheels")
    coupling_ahead: Positive = quantity(
        0.04, "m", "assumed", "of the stator's front ring: the universal joint and the motor"
    )
    rotor_ahead: Positive = quantity(0.04, "m", "assumed", "of the universal joint: the rotor")
    overhang: Positive = quantity(0.03, "m", "assumed", "beyond the outermost rings")
    coupling: Positive = quantity(
        20.0,
        "N m/rad",
        "assumed",
        "stiffness of the universal joint; with 6 the rotor runs tipped by 15 degrees after a bend",
    )
    stator_mass: Positive = quantity(0.2, "kg", "assumed", "of the stator's hull")
    rotor_mass: Positive = quantity(0.12, "kg", "assumed", "of the rotor's hull and the motor")
    arm_mass: Positive = quantity(0.04, "kg", "assumed", "of an arm with its guide")
    wheel_mass: Positive = quantity(0.03, "kg", "assumed", "of a wheel")
    speed: float = quantity(3.62, "rad/s", "derived", f"of the rotor without load; {POLOLU}")
    motor_gain: Positive = quantity(
        0.326, "N m s/rad", "derived", f"stall torque over no-load speed; {POLOLU}"
    )
    torque_limit: Positive = quantity(
        0.5, "N m", "assumed", "of the motor, twice what the maker recommends; it stalls at 1.18"
    )
    rotor_inertia: Positive = quantity(
        0.0088, "kg m²", "derived", "of the motor behind its gears: 9e-9 kg m² times 986.41²"
    )

    kind: ClassVar[str] = "screw"

    @property
    def lever(self) -> float:
        """Way for each radian of the rotor, and torque for each newton of pull, m."""
        return self.bore / 2 * math.tan(self.lead)

    def speed_at(self, rotor: float, pull: float = 0.0) -> float:
        """Return the speed, m/s, of a rotor that is asked for ``rotor`` rad/s against ``pull`` N.

        Its motor gives way to the pull.
        """
        return self.lever * (rotor - pull * self.lever / self.motor_gain)

    def slip_pull(self, friction: float) -> float:
        """Return the pull, N, from which on the rotor's wheels slip."""
        return ARMS * self.rotor_preload * friction * math.cos(self.lead)

    @property
    def input_range(self) -> Array:
        """See ``Robot``: the rotor's speed, both ways."""
        return np.array([[-abs(self.speed), abs(self.speed)]])

    def spec(self) -> mujoco.MjSpec:
        """Return the robot alone.

        +z of its chassis, the stator, points along the pipe, the origin is on the pipe's axis.
        """
        spec = new_spec("screw")
        spec.option.impratio = 100
        half = self.overhang + (self.wheelbase + self.coupling_ahead + self.rotor_ahead) / 2
        rear = self.overhang - half
        front = rear + self.wheelbase
        stator = spec.worldbody.add_body(name="chassis")
        stator.add_freejoint()
        hull = {"size": [0.02, self.wheelbase / 2 + 0.015, 0], "pos": [0, 0, (rear + front) / 2]}
        stator.add_geom(name="hull", type=CYLINDER, mass=self.stator_mass, rgba=ORANGE, **hull)
        stator.add_site(name="tail", group=4, pos=[0, 0, -half])
        for k in range(ARMS):
            # At 90 degrees wheels roll along the pipe.
            self._add_arm(stator, "stator", k, (rear, front), math.pi / 2, self.stator_preload)
        joint = front + self.coupling_ahead
        self._add_rotor(stator, joint, half - joint)
        motor = spec.add_actuator(name="drive", target="drive")
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.set_to_velocity(kv=self.motor_gain)
        motor.forcerange = [-self.torque_limit, self.torque_limit]
        return spec

    def _add_rotor(self, stator: mujoco.MjsBody, joint: float, nose: float) -> None:
        """Add the rotor behind a universal joint at ``joint`` m, its nose ``nose`` m ahead."""
        rotor = stator.add_body(name="rotor", pos=[0, 0, joint])
        for name, axis in (("bend_x", [1, 0, 0]), ("bend_y", [0, 1, 0])):
            hinge = rotor.add_joint(name=name, axis=axis, range=[-0.6, 0.6])
            hinge.stiffness[0], hinge.damping[0] = self.coupling, 0.05
        rotor.add_joint(name="drive", axis=[0, 0, 1], armature=self.rotor_inertia)
        at = self.rotor_ahead
        hub = {"type": CYLINDER, "size": [0.022, 0.014, 0], "pos": [0, 0, at], "rgba": GREY}
        rotor.add_geom(name="hub", mass=self.rotor_mass, **hub)
        shaft = {"type": CYLINDER, "rgba": DARK, "mass": 0.0, **SHELL}
        rotor.add_geom(size=[0.008, at / 2, 0], pos=[0, 0, at / 2], **shaft)
        rotor.add_geom(size=[0.012, 0.006, 0], pos=[0, 0, nose - 0.006], **shaft)
        rotor.add_site(name="nose", group=4, pos=[0, 0, nose])
        for k in range(ARMS):
            self._add_arm(rotor, "rotor", k, (at,), self.lead, self.rotor_preload)

    def _add_arm(
        self,
        body: mujoco.MjsBody,
        whose: str,
        k: int,
        places: tuple[float, ...],
        lead: float,
        preload: float,
    ) -> None:
        """Add sprung arm ``k`` with a wheel at each of the ``places``, m.

        The wheels roll at the angle ``lead`` to the pipe's cross section.
        """
        angle, reach = 2 * math.pi * k / ARMS, self.bore / 2 - self.wheel_radius
        arm = body.add_body(
            name=f"{whose}_{k}",
            pos=[reach * math.cos(angle), reach * math.sin(angle), 0],
            quat=[math.cos(angle / 2), 0, 0, math.sin(angle / 2)],
        )
        guide = arm.add_joint(
            name=f"{whose}_guide_{k}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[1, 0, 0],
            range=[-self.travel_in, self.travel_out],
            springref=preload / self.stiffness,
        )
        guide.stiffness[0], guide.damping[0] = self.stiffness, self.damping
        inner, outer = 0.018 - reach, -0.3 * self.wheel_radius
        for i, place in enumerate(places):
            ends = [inner, 0, place, outer, 0, place]
            rod = {"type": CAPSULE, "size": [0.004, 0, 0], "fromto": ends, "rgba": GREY}
            arm.add_geom(mass=self.arm_mass / len(places), **rod, **SHELL)
            self._add_wheel(arm, f"{whose}_{k}_{i}", place, lead)

    def _add_wheel(self, arm: mujoco.MjsBody, name: str, place: float, lead: float) -> None:
        """Add a passive wheel with a round tyre, which touches the wall at one point."""
        wheel = arm.add_body(name=f"wheel_{name}", pos=[0, 0, place])
        axle = [0.0, math.sin(lead), -math.cos(lead)]
        wheel.add_joint(name=f"wheel_{name}", axis=axle, armature=1e-5)
        # The short axis of the ellipsoid, its own z, lies along the axle.
        half = (math.pi + lead) / 2
        radius = self.wheel_radius
        turn = {"quat": [math.cos(half), math.sin(half), 0, 0]}
        wheel.add_geom(
            name=f"tyre_{name}",
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=[radius, radius, self.tyre_width / 2],
            mass=self.wheel_mass,
            friction=[self.friction, 0.005, 0.0001],
            solref=[0.005, 1],
            rgba=DARK,
            **turn,
        )
        rim = {"type": CYLINDER, "rgba": ORANGE, "mass": 0.0, **SHELL, **turn}
        wheel.add_geom(size=[0.5 * radius, 0.51 * self.tyre_width, 0], **rim)

    def gait(self, observation: Any) -> Array:
        """See ``Robot``: the rotor (n, 1) turns at one speed, rad/s, after a start."""
        time = np.broadcast_to(observation.time, len(observation.qpos))
        return self.speed * np.clip(time / RAMP, 0.0, 1.0)[:, None]
