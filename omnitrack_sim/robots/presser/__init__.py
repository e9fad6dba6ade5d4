"""A wheeled wall-presser: three sprung arms, each with a driven wheel at both ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Positive
from omnitrack_sim.robots.quantity import quantity
from omnitrack_sim.robots.robot import Robot


class Presser(Robot):
    """A wall-presser that drives straight on by six wheels of the same speed.

    Its springs hold it: it climbs while ``3 * preload * friction`` exceeds its weight. On the
    motors' line a wheel of radius r that carries a sixth of the weight falls behind its speed
    without load,

        v = r (speed / r - m g r / (6 k)),    k: stall torque over no-load speed, 0.326 N m s

    where r ends in the middle of the tyre's sinkage, 0.1 mm at 40 N.

    Example:
        >>> from omnitrack_sim.robots.presser import Presser
        >>> Presser(preload=50.0).spec().compile().nu
        6
    """

    bore: Positive = quantity(0.16, "m", "assumed", "of the pipe that its arms are set for")
    preload: Positive = quantity(40.0, "N", "assumed", "of each arm's spring at that bore")
    friction: Positive = quantity(
        0.8, "1", "assumed", "of the tyres, rubber on a dry pipe, where the walls state none"
    )
    speed: float = quantity(
        0.087, "m/s", "derived", "of the tyres without load: 3.62 rad/s of the motors at 12 V"
    )

    WHEEL_RADIUS: ClassVar[float] = 0.024
    """m."""

    @property
    def nominal_bore(self) -> float:
        """See ``Robot``."""
        return self.bore

    def spec(self) -> mujoco.MjSpec:
        """Return the robot alone: +z of its chassis points along the pipe, the origin is on the
        pipe's axis."""
        spec = mujoco.MjSpec.from_file(str(Path(__file__).with_name("robot.xml")))
        for k in range(3):
            tyre = spec.geom(f"front_{k}")
            # A tyre of finite width touches the bore with its two edges.
            reach = math.sqrt(self.bore**2 / 4 - tyre.size[1] ** 2) - self.WHEEL_RADIUS
            arm, guide = spec.body(f"arm_{k}"), spec.joint(f"guide_{k}")
            arm.pos = reach * arm.pos / np.linalg.norm(arm.pos)
            guide.springref = self.preload / guide.stiffness[0]
            for end in ("front", "rear"):
                spec.geom(f"{end}_{k}").friction[0] = self.friction
        return spec

    @property
    def input_range(self) -> Array:
        """See ``Robot``: the wheels' speeds, both ways."""
        fastest = abs(self.speed) / self.WHEEL_RADIUS
        return np.tile([-fastest, fastest], (6, 1))

    def controller(self) -> Wheels:
        """Return the controller that turns all wheels alike."""
        return Wheels(self.speed / self.WHEEL_RADIUS)


@dataclass(frozen=True)
class Wheels:
    """All wheels at one commanded speed.

    Attributes:
        speed: rad/s, of a wheel without load.
        period: s, between commands.
    """

    speed: float
    period: float = 0.02

    def reset(self, rows: Any) -> None:
        """Begin anew; it remembers nothing."""

    def command(self, observation: Any) -> Array:
        """Return the speeds (n, 6) of n robots' wheels, rad/s."""
        return np.full((len(observation.qpos), 6), self.speed)
