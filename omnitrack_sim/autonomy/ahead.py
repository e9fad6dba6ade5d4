"""What a robot sees of the pipe ahead of it, whoever tells: a recogniser of pictures, or the true
network."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from omnitrack_sim.base.rotations import Array, unit
from omnitrack_sim.pipes import Fitting


@dataclass(frozen=True)
class Ahead:
    """What a robot sees ahead of it in its pipe, at one moment.

    "Ahead" is where the robot drives to: beyond its nose in gear 1, beyond its tail in gear -1. Its
    frame is that of the gear, which has z ahead and x towards module 1 in both
    (``robots/omnitrack/control/gear.py``).

    Attributes:
        fitting: the next one that the robot's centre has not come into and that is no plain
            straight of the same bore, with its sizes as seen; None: nothing but straight pipe as
            far as is seen, or an end. The nose may be in it already.
        enter: port of ``fitting`` by which it would be entered; "" without one. Where a fitting
            looks the same from two ports, such as an elbow or a tee from either end of its run,
            either of them.
        end: the pipe ends there, "open" or "closed"; "" where it does not, or goes into a fitting.
        distance: m, along the pipe's axis from the robot's centre to the port plane of what is
            seen, or to where sight ends.
        turn: rad, from the robot's x axis, projected across the pipe, to the x axis of the port
            ``enter`` (``Fitting.ports``), about the pipe's axis ahead. It is the turn of
            ``pipes.attached`` for a placed port whose x axis is that projection (``side_of``). 0
            for a fitting that is round about its axis.
        distance_std, turn_std: m and rad, standard deviations.
        sure: probability, 0 to 1, that the kind of ``fitting``, or of the end, is right.
        axis: (3,) unit vector along the pipe ahead, in the robot's frame.
    """

    fitting: Fitting | None = None
    enter: str = ""
    end: str = ""
    distance: float = 0.0
    turn: float = 0.0
    distance_std: float = 0.0
    turn_std: float = 0.0
    sure: float = 1.0
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]), compare=False)


def side_of(frame: Array, ahead: Array) -> Array:
    """The x axis (3,) of a robot's ``frame`` (3, 3), projected across a pipe along ``ahead``
    (3,), world frame: what ``Ahead.turn`` is measured from."""
    x = frame[:, 0]
    return unit(x - ahead * (x @ ahead))


class Look(NamedTuple):
    """A robot has looked ahead, and maybe back.

    Attributes:
        time: s. distance: m, arc length of its centre on its leg, as it takes it to be.
        ahead, behind: what it has seen; None where it cannot tell, or has not looked.
        frame: (3, 3) of the robot in its gear, world frame, as it takes it to be.
        turned: (3, 3) the same by the gyro alone, in any frame that stands still.
    """

    time: float
    distance: float
    ahead: Ahead | None
    behind: Ahead | None
    frame: Array
    turned: Array


class Sight(Protocol):
    """Tells what robots see ahead of them."""

    def look(self, robot: int, position: Array, frame: Array) -> Ahead | None:
        """What one robot sees now; None where it cannot tell, such as within a bend.

        Args:
            robot: index in its batch.
            position: (3,) m, of the robot's centre, world frame, the true one.
            frame: (3, 3) of the robot in its gear, in the world, the true one.
        """
        ...
