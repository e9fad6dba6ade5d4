"""Relocalisation of lost robots: they stand, look, step back and roll, and give up in the end.

A lost robot never drives on blindly.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, set_rows, with_rows
from omnitrack_sim.record.events import Event, FoundItself, LostItself
from omnitrack_sim.robots.odometry import LookAround, Odometry
from omnitrack_sim.senses.settings import SearchTable

Readings = Mapping[str, Array]


class Search:
    """Search of n robots for their pose: rounds of looking, stepping back, looking and rolling.

    Args:
        table: ``[sensing.search]``.
        odometry: of the robots.
        n: number of robots.
    """

    def __init__(self, table: SearchTable, odometry: Odometry, n: int) -> None:
        self._table, self._odometry = table, odometry
        self._step, rate = float(odometry.robot.own_length(table.step)), odometry.roll_rate
        self._turn = np.radians(table.roll_deg) if rate else 0.0
        self._rolling = self._turn / rate if rate else 0.0
        # Who cannot roll sees something else only from another place.
        self._first_step = table.tries / 2 if rate else 0
        self._speed, self._back, self._round, self._since = np.zeros((4, n))  # m/s, then s
        self._begun: Readings = {}

    def reset(self, rows: NDArray[np.intp], speed: Array) -> None:
        """Begin anew for robots ``rows`` (k,) that cruise at ``speed`` (k,) m/s and step back at
        half of that."""
        back = self._step / (speed / 2)
        whole = 2 * self._table.look + back + self._rolling
        set_rows(self, rows, _speed=speed / 2, _back=back, _round=whole, _since=np.nan)

    def step(
        self, command: Any, lost: NDArray[np.bool_], readings: Readings, gear: NDArray[np.int_]
    ) -> tuple[Any, NDArray[np.bool_]]:
        """Return the commands with those of lost robots replaced, and without their events, and the
        robots (n,) that have searched in vain.

        Args:
            command: of the controller.
            lost: (n,) robots that do not know where they are.
            readings: (n, ...) as the controller receives them.
            gear: (n,) 1 nose first, -1 tail first.
        """
        time = readings["time"]
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
        if np.count_nonzero(began):
            rows = np.flatnonzero(began)
            self._begun = {
                name: with_rows(self._begun.get(name, values), rows, values[rows])
                for name, values in readings.items()
            }
        if not np.count_nonzero(lost):
            return command, lost
        given_up = time - self._since > self._table.tries * self._round
        speed, turn = self._round_at(np.where(lost, time - self._since, 0.0))
        order = LookAround(lost, speed, turn, gear, self._begun, readings)
        command = self._odometry.look_around(command, order)
        resting = lost if command.resting is None else command.resting | lost
        return command._replace(resting=resting), given_up

    def _round_at(self, elapsed: Array) -> tuple[Array, Array]:
        """Return the speeds (n,) m/s and turns (n,) rad to be had ``elapsed`` (n,) s after a search
        began."""
        number, phase = np.divmod(elapsed, self._round)
        look = self._table.look
        steps = (phase > look) & (phase < look + self._back) & (number >= self._first_step)
        speed, turn = -np.where(steps, self._speed, 0.0), np.zeros(len(elapsed))
        if self._rolling:
            rolled = np.clip((phase - 2 * look - self._back) / self._rolling, 0.0, 1.0)
            turn = (number + rolled) * self._turn
        return speed, turn
