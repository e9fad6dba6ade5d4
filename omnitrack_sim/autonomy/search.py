"""What a robot does that does not know where it is: it stands, looks, steps back, rolls, and gives
up in the end. It never drives on blindly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.events import Event, FoundItself, LostItself
from omnitrack_sim.robots.omnitrack import Robot
from omnitrack_sim.robots.omnitrack.control.interface import Command
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.senses.table import SearchTable


class Searching(NamedTuple):
    """The command with which robots that search stand, step back or roll; who searches (n,), and
    who gives up (n,)."""

    command: Command
    searching: NDArray[np.bool_]
    given_up: NDArray[np.bool_]
    events: Sequence[Event]


class Search:
    """Which of n robots search for their place, and what they do.

    Args:
        table: ``[sensing.search]``. robot: shared by all. speed: (n,) m/s, of stepping back.
    """

    def __init__(self, table: SearchTable, robot: Robot, speed: Array) -> None:
        self._table, self._speed = table, speed / 2
        self._back = table.step * robot.nominal_bore / self._speed  # (n,) s
        turn = np.radians(table.roll_deg)
        self._rolling = turn / robot.roll_rate
        self._turn = turn
        self._round = 2 * table.look + self._back + self._rolling
        self._since = np.full(len(speed), np.nan)
        self._roll = np.zeros((len(speed), 3))

    def step(
        self, command: Command, lost: NDArray[np.bool_], time: Array, roll: Array
    ) -> Searching:
        """What robots do now.

        Args:
            command: of the controller. lost: (n,) robots that do not know where they are.
            time: (n,) s. roll: (n, 3) rad, of the modules.
        """
        began = lost & np.isnan(self._since)
        ended = ~lost & ~np.isnan(self._since)
        events: list[Event] = [
            kind(robot, float(time[robot]))
            for flags, kind in ((began, LostItself), (ended, FoundItself))
            if np.count_nonzero(flags)
            for robot in np.flatnonzero(flags).tolist()
        ]
        self._since = np.where(began, time, np.where(lost, self._since, np.nan))
        self._roll = np.where(began[:, None], roll, self._roll)
        nobody = np.zeros(len(lost), bool)
        if not np.count_nonzero(lost):
            return Searching(command, lost, nobody, events)
        asked = self._searching(command, lost, time, roll)
        return Searching(asked, lost, self._given_up(time), events)

    def _given_up(self, time: Array) -> NDArray[np.bool_]:
        return time - self._since > self._table.tries * self._round

    def _searching(
        self, command: Command, lost: NDArray[np.bool_], time: Array, roll: Array
    ) -> Command:
        elapsed = np.where(lost, time - self._since, 0.0)
        number, phase = np.divmod(elapsed, self._round)
        look = self._table.look
        backing = (phase > look) & (phase < look + self._back) & (number >= self._table.tries / 2)
        rolled = number + np.clip((phase - 2 * look - self._back) / self._rolling, 0.0, 1.0)
        each = lost[:, None]
        back = -np.where(backing, self._speed, 0.0)[:, None] * belt_sign(roll)
        asked = self._roll + (rolled * self._turn)[:, None]
        before = roll if command.roll is None else command.roll
        resting = lost if command.resting is None else command.resting | lost
        return command._replace(
            belt_speed=np.where(each, back, command.belt_speed),
            roll=np.where(each, asked, before),
            resting=resting,
        )
