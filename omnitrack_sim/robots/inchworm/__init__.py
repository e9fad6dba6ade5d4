"""An inchworm: two clamps and a spindle between them that extends."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Positive
from omnitrack_sim.robots.quantity import quantity
from omnitrack_sim.robots.robot import Robot

ENDS = ("rear", "front")
"""The clamps."""
RETURN = -5.0
"""Force, N, that draws the pads of an open clamp back."""


class Inchworm(Robot):
    """An inchworm whose clamps hold in turn while its spindle extends and contracts.

    A closed clamp of eight pads carries ``8 * friction * grip`` N along a straight. Each cycle of
    ``2 * (stretch_time + 2 * switch_time)`` s takes it forward by

        stride - m g / k,    k: ``spindle_stiffness``; g: component against its motion

    as the spindle is shorter by the weight in front of it when the front clamp closes, and longer
    by the weight behind it when the rear clamp closes.

    Example:
        >>> from omnitrack_sim.robots.inchworm import Inchworm
        >>> model = Inchworm(grip=30.0).spec().compile()
        >>> [model.actuator(i).name for i in range(model.nu)]
        ['spindle', 'rear_grip', 'front_grip']
    """

    kind: ClassVar[str] = "inchworm"
    bore: Positive = quantity(0.16, "m", "assumed", "of the pipe that its pads are set for")
    grip: Positive = quantity(25.0, "N", "assumed", "of each pad of a closed clamp")
    friction: Positive = quantity(
        0.8, "1", "assumed", "of the pads, where the walls state none; runners have 0.1"
    )
    stride: Positive = quantity(0.05, "m", "assumed", "by which the spindle extends; 0.05 at most")
    stretch_time: Positive = quantity(0.5, "s", "assumed", "in which it extends or contracts")
    switch_time: Positive = quantity(
        0.1, "s", "assumed", "that a clamp gets to close, and that it gets to open"
    )

    spindle_stiffness: Positive = quantity(20e3, "N/m", "assumed", "of the spindle's position loop")
    spindle_force: Positive = quantity(80.0, "N", "assumed", "of the spindle at most")
    bend_stiffness: Positive = quantity(
        3.0, "N m/rad", "assumed", "of the universal joints between spindle and clamps"
    )
    tube_mass: Positive = quantity(0.2, "kg", "assumed", "of the spindle's tube")
    rod_mass: Positive = quantity(0.1, "kg", "assumed", "of the spindle's rod")
    drum_mass: Positive = quantity(0.3, "kg", "assumed", "of a clamp's drum")
    pad_mass: Positive = quantity(0.02, "kg", "assumed", "of each of a clamp's eight pads")

    def spec(self) -> mujoco.MjSpec:
        """Return the robot alone.

        +z of its chassis points along the pipe, the origin is on the pipe's axis.
        """
        spec = mujoco.MjSpec.from_file(str(Path(__file__).with_name("robot.xml")))
        for pad in (f"{end}_{ring}_{k}" for end in ENDS for ring in "ab" for k in range(4)):
            body = spec.body(pad)
            outwards = body.pos * [1, 1, 0]
            body.pos += (self.bore - 0.16) / 2 * outwards / np.linalg.norm(outwards)
            spec.geom(pad).friction[0], spec.geom(pad).mass = self.friction, self.pad_mass
        spec.geom("tube").mass, spec.geom("rod").mass = self.tube_mass, self.rod_mass
        for end in ENDS:
            spec.geom(f"{end}_drum").mass = self.drum_mass
            for axis in "xy":
                spec.joint(f"{end}_{axis}").stiffness[0] = self.bend_stiffness
        spindle = spec.actuator("spindle")
        spindle.set_to_position(kp=self.spindle_stiffness, kv=200.0)
        spindle.forcerange = [-self.spindle_force, self.spindle_force]
        return spec

    @property
    def start_ctrl(self) -> Array:
        """See ``Robot``: both clamps are closed."""
        return np.array([0.0, self.grip, self.grip])

    def gait(self, observation: Any) -> Array:
        """See ``Robot``: length (n,) of the spindle, m, and forces, N, of the pads of both clamps.

        The rear clamp holds while it extends, the front one while it contracts. Before each move
        both are closed for a time, and one opens before the spindle starts.
        """
        half = self.stretch_time + 2 * self.switch_time
        in_cycle = np.asarray(observation.time) % (2 * half)
        in_half, extends = in_cycle % half, in_cycle < half
        moved = np.clip((in_half - 2 * self.switch_time) / self.stretch_time, 0.0, 1.0)
        opens = in_half >= self.switch_time
        command = np.empty((len(observation.qpos), 3))
        command[:, 0] = self.stride * np.where(extends, moved, 1.0 - moved)
        command[:, 1] = np.where(opens & ~extends, RETURN, self.grip)
        command[:, 2] = np.where(opens & extends, RETURN, self.grip)
        return command
