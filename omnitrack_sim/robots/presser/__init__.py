"""A wheeled wall-presser of the literature: three sprung arms, each with a wheel at both ends.

The speeds of its wheels follow from a bend's geometry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, heading
from omnitrack_sim.base.table import Positive
from omnitrack_sim.robots.control import Actuation, Controller, ControlSetup, Observation
from omnitrack_sim.robots.presser.odometry import ARMS, WheelOdometry
from omnitrack_sim.robots.quantity import quantity
from omnitrack_sim.robots.robot import Robot

POLOLU = "Pololu 1000:1 HPCB 12 V, figures of the maker for other ratios, scaled"


class Presser(Robot):
    """A wall-presser on three arms at 120 degrees, of the kind of MRINSPECT IV and SmartCrawler.

    Its springs hold it: it climbs while ``3 * preload * friction`` exceeds its weight. On the
    motors' line a wheel of radius r that carries a sixth of the weight falls behind its speed
    without load,

        v = r (speed / r - m g r / (6 k)),    k: stall torque over no-load speed, ``motor_gain``

    where r ends in the middle of the tyre's sinkage, 0.1 mm at 40 N.

    Example:
        >>> from omnitrack_sim.robots.presser import Presser
        >>> Presser(preload=50.0).spec().compile().nu
        6
    """

    bore: Positive = quantity(
        0.16,
        "m",
        "assumed",
        "of the pipe that its arms are set for; MRINSPECT IV is for a nominal 4 in, SmartCrawler "
        "for 9 to 22 in (their abstracts)",
    )
    preload: Positive = quantity(40.0, "N", "assumed", "of each arm's spring at that bore")
    stiffness: Positive = quantity(2000.0, "N/m", "assumed", "of each arm's spring")
    damping: Positive = quantity(20.0, "N s/m", "assumed", "of each arm's guide rods")
    travel_in: Positive = quantity(0.009, "m", "assumed", "of an arm towards the hull")
    travel_out: Positive = quantity(
        0.012, "m", "assumed", "of an arm beyond the wall; with 6 mm a wheel hangs in the air"
    )
    wheel_radius: Positive = quantity(0.024, "m", "assumed", "of the tyres")
    tyre_width: Positive = quantity(0.014, "m", "assumed", "of the tyres")
    wheelbase: Positive = quantity(0.104, "m", "assumed", "between the wheels of an arm")
    hull_length: Positive = quantity(
        0.156, "m", "assumed", "from nose to tail; the hull is thinner or thicker in proportion"
    )
    drum_mass: Positive = quantity(0.3, "kg", "assumed", "of the drum in the middle")
    core_mass: Positive = quantity(0.15, "kg", "assumed", "of the hull through the drum")
    beam_mass: Positive = quantity(0.03, "kg", "assumed", "of each of an arm's two beams")
    wheel_mass: Positive = quantity(0.035, "kg", "assumed", "of a wheel with its gearmotor")
    friction: Positive = quantity(
        0.8, "1", "assumed", "of the tyres, rubber on a dry pipe, where the walls state none"
    )
    speed: float = quantity(
        0.087, "m/s", "derived", "of the tyres without load: 3.62 rad/s of the motors at 12 V"
    )
    motor_gain: Positive = quantity(
        0.326, "N m s/rad", "derived", f"stall torque over no-load speed; {POLOLU}"
    )
    torque_limit: Positive = quantity(0.245, "N m", "derived", f"of a motor; {POLOLU}")
    wheel_inertia: Positive = quantity(
        4e-4, "kg m²", "assumed", "of a wheel with its motor behind the gears"
    )

    kind: ClassVar[str] = "presser"

    @classmethod
    def controllers(cls) -> Mapping[str, type[Controller]]:
        """See ``Robot``."""
        return {"bend": BendSpeeds, **super().controllers()}

    @property
    def nominal_speed(self) -> float:
        """See ``Robot``."""
        return self.speed

    def spec(self) -> mujoco.MjSpec:
        """See ``Robot``: +z of the chassis points along the pipe, its origin is on the axis."""
        spec = mujoco.MjSpec.from_file(str(Path(__file__).with_name("robot.xml")))
        self._set_hull(spec)
        for k in range(3):
            # A tyre of finite width touches the bore with its two edges.
            reach = math.sqrt(self.bore**2 / 4 - self.tyre_width**2 / 4) - self.wheel_radius
            arm = spec.body(f"arm_{k}")
            arm.pos = reach * arm.pos / np.linalg.norm(arm.pos)
            self._set_guide(spec.joint(f"guide_{k}"))
            for beam in (spec.geom(f"left_{k}"), spec.geom(f"right_{k}")):
                beam.mass = self.beam_mass
                # Half of the wheelbase and the beam's end, as in the file.
                beam.size[2] = self.wheelbase * 0.056 / 0.104
            for end, side in (("front", 1), ("rear", -1)):
                spec.body(f"{end}_{k}").pos[2] = side * self.wheelbase / 2
                self._set_wheel(spec, f"{end}_{k}")
        return spec

    def _set_hull(self, spec: mujoco.MjSpec) -> None:
        """Give the hull its size, and with it all that is fixed to it or to an arm."""
        size = self.hull_length / 0.156  # that of the file
        for geom in spec.geoms:
            geom.size, geom.pos = size * geom.size, size * geom.pos
        for fixed in (*spec.sites, *spec.cameras):
            fixed.pos = size * fixed.pos
        spec.geom("drum").mass, spec.geom("core").mass = self.drum_mass, self.core_mass

    def _set_guide(self, guide: mujoco.MjsJoint) -> None:
        """Give an arm's guide its spring and its stops."""
        guide.stiffness[0], guide.damping[0] = self.stiffness, self.damping
        guide.range = [-self.travel_in, self.travel_out]
        guide.springref = self.preload / self.stiffness

    def _set_wheel(self, spec: mujoco.MjSpec, name: str) -> None:
        """Give a wheel its tyre and its motor."""
        tyre, motor = spec.geom(name), spec.actuator(name)
        tyre.size = [self.wheel_radius, self.tyre_width / 2, 0]
        tyre.mass, tyre.friction[0] = self.wheel_mass, self.friction
        spec.joint(name).armature = self.wheel_inertia
        motor.set_to_velocity(kv=self.motor_gain)
        motor.forcerange = [-self.torque_limit, self.torque_limit]

    @property
    def input_range(self) -> Array:
        """See ``Robot``: the wheels' speeds, both ways."""
        fastest = abs(self.speed) / self.wheel_radius
        return np.tile([-fastest, fastest], (6, 1))

    def gait(self, observation: Any) -> Array:
        """See ``Robot``: all wheels (n, 6) turn alike, rad/s."""
        return np.full((len(observation.time), 6), self.speed / self.wheel_radius)

    def odometry(self) -> WheelOdometry:
        """See ``Robot``."""
        return WheelOdometry(self)


class BendSpeeds:
    """Wheel speeds in proportion to each arm's distance from the bend's centre.

    Where the pipe bends with radius R, a wheel of an arm at the angle theta from the bend's
    inside rolls at

        v_i = v (R - r cos theta) / R,    r: radius of the bore

    and v is as large as the fastest wheel's motor allows. Into a branch the centreline bends with
    the radius of the bore, and the inner arm stands still. As with MRINSPECT IV the speeds follow
    from the fitting and the robot's roll in it, without measuring contacts.
    """

    def __init__(self, setup: ControlSetup) -> None:
        robot: Presser = setup.robot
        self._speed, self._bore_radius = robot.speed / robot.wheel_radius, robot.bore / 2

    def step(self, observation: Observation) -> Actuation:
        """Return the speeds of all wheels, by where the robots are."""
        place, gear = observation.location, observation.gear
        # The location's frame points ahead; in reverse the arms stand the other way round in it.
        frame = heading(place.frame, gear)
        ratios = bend_ratios(frame, place.normal, self._bore_radius * place.curvature)
        fastest = np.abs(ratios).max(axis=1, keepdims=True)
        return Actuation(np.tile(gear[:, None] * self._speed * ratios / fastest, 2))


def bend_ratios(frame: Array, inwards: Array, sharpness: Array) -> Array:
    """Return the speeds (n, 3) of arms' wheels over that of the robot, (R - r cos theta) / R.

    Args:
        frame: (n, 3, 3) of the robots.
        inwards: (n, 3) unit vectors from the robots to the bends' centres.
        sharpness: (n,) radius of the bore over that of the bend, r / R; 0 in a straight.
    """
    x, y = (np.einsum("ni,ni->n", frame[:, :, k], inwards) for k in (0, 1))
    cosines = np.cos(ARMS) * x[:, None] + np.sin(ARMS) * y[:, None]
    return 1 - sharpness[:, None] * cosines
