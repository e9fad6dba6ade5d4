"""A wheeled wall-presser: three sprung arms, each with a driven wheel at both ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Positive, Unit
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

    bore: Annotated[Positive, Unit("m")] = 0.16
    """Of the pipe that its arms are set for."""
    preload: Annotated[Positive, Unit("N")] = 40.0
    """Of each arm's spring at that bore."""
    friction: Annotated[Positive, Unit("1")] = 0.8
    """Of the tyres, where the walls state none."""
    speed: Annotated[float, Unit("m/s")] = 0.087
    """Of the tyres without load; 0.087 is the motors' at 12 V."""

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
