"""Command to the robot's modules."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import shown
from omnitrack_sim.record.events import Event


class Command(NamedTuple):
    """Commands to n robots until the next control step. Fields that are None keep their values.

    Attributes:
        belt_speed: (n, 3) m/s asked of the crawler motors.
        roll: (n, 3) rad asked of the rotary motors.
        phase: (n,) index into the controller's ``phases``.
        resting: (n,) bool, robots that stand still or drive backward on purpose, which the monitor
            does not count as stuck; none when left out.
        events: decisions of the controller, kept in the result.
        brake: (n, 3) part of ``robot.brake_force``, 0 to 1, by which the belts are braked; all off
            when left out, and to be 0 where the robot has no brakes.
        over: (n,) bool, robots whose run is over after this control period; none when left out.

    Example:
        >>> import numpy as np
        >>> import omnitrack_sim as ot
        >>> ot.Command(belt_speed=np.full((2, 3), 0.1), roll=np.zeros((2, 3)))
        Command(2 robots: belt_speed, roll, events)
    """

    belt_speed: Array
    roll: Array | None = None
    phase: NDArray | None = None
    resting: NDArray[np.bool_] | None = None
    events: Sequence[Event] = ()
    brake: Array | None = None
    over: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        names = [name for name, value in zip(self._fields, self, strict=True) if value is not None]
        try:
            robots = f"{len(self.belt_speed)} robots"
        except TypeError:  # no array yet, and refused where it is used
            robots = f"belt_speed {shown(self.belt_speed)}, which is no (n, 3)"
        return f"Command({robots}: {', '.join(names)})"
