"""What a learned controller decides, and what it is added to.

A decision is four numbers within -1 and 1: the forward speed of each module at the wall, over the
speed limit, and the rate at which all modules roll together, over the rotary motor's largest speed.
It holds for one decision period.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from omnitrack_sim.base.naming import ByName

ACTIONS = ("wall_speed_1", "wall_speed_2", "wall_speed_3", "roll_rate")
"""Names of the entries of an action."""
DECISION_PERIOD = 0.05
"""Time that a decision holds, s: 5 mm of travel at 0.1 m/s, a third of the time in which the
springs can turn a robot over in a tee."""


@dataclass(frozen=True)
class Acting:
    """How a decision becomes a command.

    Attributes:
        name: of this way to act.
        base: the shipped controller to whose command the decision is added; none: it is the
            command. While the base stands or backs off, the decision counts for nothing.
        speed: part of the speed limit that an action of 1 stands for.
        roll_reach: rad, by how much the roll may be off that of the base; infinite without one.
    """

    name: str
    base: str | None = None
    speed: float = 1.0
    roll_reach: float = math.inf


DIRECT = Acting("direct")
# Where walls are slippery and the way leads down, a turn has to be driven otherwise than the base
# drives it, so belts may do anything. 0.3 rad of roll turn the robot by 6 degrees, half the safe
# range of theta5.
RESIDUAL = Acting("residual", base="jacobian", roll_reach=0.3)
ACTINGS: Mapping[str, Acting] = ByName({acting.name: acting for acting in (DIRECT, RESIDUAL)})
"""Ways to act by name."""
