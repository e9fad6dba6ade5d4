"""Display of a robot of which a saved run tells what it shows."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from omnitrack_sim.pipes import Assembly, Port
from omnitrack_sim.record.display import CarriedCamera
from omnitrack_sim.robots.display import RobotDisplay
from omnitrack_sim.robots.recorded import Recorded


class RecordedDisplay(RobotDisplay):
    """Display of a recorded robot: its model for pictures, and its own choice of figures."""

    def __init__(self, robot: Recorded) -> None:
        super().__init__(robot)
        for name, value in robot.values.looks or ():
            if name != "camera":
                setattr(self, name, value)

    def spec(
        self,
        network: Assembly,  # noqa: ARG002 - the model has the plates of its run
        plates: Sequence[Port] = (),  # noqa: ARG002
        coarse: bool = True,  # noqa: ARG002
    ) -> mujoco.MjSpec:
        """See ``RobotDisplay``."""
        return self.robot.spec()

    @property
    def camera(self) -> CarriedCamera:
        """See ``RobotDisplay``."""
        looks = self.robot.values.looks
        return super().camera if looks is None else CarriedCamera(*looks.camera)
