"""Plant of robots of a model file, which may differ in values of their joints and actuators."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.robots.plant import Plant, Start
from omnitrack_sim.robots.scene import compiled

FIELDS = (
    *("jnt_stiffness", "dof_damping", "dof_frictionloss"),
    *("actuator_gainprm", "actuator_biasprm"),
)
"""Fields of a model that the values make in which robots of one batch may differ, see
``Mjcf.own_values``. None of them enters MuJoCo's derived constants (``_setconst_inputs``)."""


class FilePlant(Plant):
    """n copies of a robot of a file, each with its own values; see ``Plant``."""

    def _set_start(self, rows: NDArray[np.intp], start: Start) -> None:
        super()._set_start(rows, start)
        self._set_fields(rows, FIELDS, [compiled(robot) for robot in start.robots])
