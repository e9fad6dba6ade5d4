"""Relocalisation of lost robots: they stand, look, step back and roll, and give up in the end. A
lost robot never drives on blindly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, set_rows
from omnitrack_sim.record.events import Event, FoundItself, LostItself
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.control.command import Command
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.senses.settings import SearchTable


class Search:
    """Search of n robots for their pose.

    Args:
        table: ``[sensing.search]``.
        robot: shared by all.
        n: number of robots.
    """

    def __init__(self, table: SearchTable, robot: Omnitrack, n: int) -> None:
        self._table, self._step = table, float(robot.own_length(table.step))
        self._turn = np.radians(table.roll_deg)
        self._rolling = self._turn / robot.roll_rate
        self._speed, self._back, self._round, self._since = np.zeros((4, n))  # m/s, then s
        self._roll = np.zeros((n, 3))

    def reset(self, rows: NDArray[np.intp], speed: Array) -> None:
        """Begin anew for robots ``rows`` (k,) that cruise at ``speed`` (k,) m/s and step back at
        half of that."""
        back = self._step / (speed / 2)
        whole = 2 * self._table.look + back + self._rolling
        set_rows(self, rows, _speed=speed / 2, _back=back, _round=whole, _since=np.nan, _roll=0.0)

    def step(
        self, command: Command, lost: NDArray[np.bool_], time: Array, roll: Array
    ) -> tuple[Command, NDArray[np.bool_]]:
        """Return the commands with those of lost robots replaced, and without their events, and the
        robots (n,) that have searched in vain.

        Args:
            command: of the controller.
            lost: (n,) robots that do not know where they are.
            time: (n,) s.
            roll: (n, 3) rad, of the modules.
        """
        began = lost & np.isnan(self._since)
        ended = ~lost & ~np.isnan(self._since)
        events: list[Event] = [
            kind(robot, float(time[robot]))
            for flags, kind in ((began, LostItself), (ended, FoundItself))
            if np.count_nonzero(flags)
            for robot in np.flatnonzero(flags).tolist()
        ]
        kept = [event for event in command.events if not lost[event.robot]]
        command = command._replace(events=[*kept, *events])
        self._since = np.where(began, time, np.where(lost, self._since, np.nan))
        self._roll = np.where(began[:, None], roll, self._roll)
        if not np.count_nonzero(lost):
            return command, lost
        given_up = time - self._since > self._table.tries * self._round
        return self._searching(command, lost, time, roll), given_up

    def _searching(
        self, command: Command, lost: NDArray[np.bool_], time: Array, roll: Array
    ) -> Command:
        elapsed = np.where(lost, time - self._since, 0.0)
        # A round: look, step back (in the second half of the rounds), look, roll.
        number, phase = np.divmod(elapsed, self._round)
        look = self._table.look
        backing = (phase > look) & (phase < look + self._back) & (number >= self._table.tries / 2)
        rolled = number + np.clip((phase - 2 * look - self._back) / self._rolling, 0.0, 1.0)
        each = lost[:, None]
        back = -np.where(backing, self._speed, 0.0)[:, None] * belt_sign(roll)
        target = self._roll + (rolled * self._turn)[:, None]
        before = roll if command.roll is None else command.roll
        resting = lost if command.resting is None else command.resting | lost
        return command._replace(
            belt_speed=np.where(each, back, command.belt_speed),
            roll=np.where(each, target, before),
            resting=resting,
        )
