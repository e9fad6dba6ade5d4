"""Relocalisation of lost robots: they stand, look, step back and roll, and give up in the end.

A lost robot never drives on blindly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.localiser import Localiser
from omnitrack_sim.base.rotations import Array, heading, set_rows, with_rows
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Event, FoundItself, LostItself
from omnitrack_sim.robots.odometry import LookAround, Odometry
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.senses.settings import SearchTable

Readings = Mapping[str, Array]


class PoseSearch:
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
        """Begin anew.

        Args:
            rows: (k,) numbers of the robots.
            speed: (k,) m/s, at which they cruise; they step back at half of that.
        """
        back = self._step / (speed / 2)
        whole = 2 * self._table.look + back + self._rolling
        set_rows(self, rows, _speed=speed / 2, _back=back, _round=whole, _since=np.nan)

    def step(
        self, command: Any, lost: NDArray[np.bool_], readings: Readings, gear: NDArray[np.int_]
    ) -> tuple[Any, NDArray[np.bool_]]:
        """Return the commands with those of lost robots replaced, and without their events.

        The second value are the robots (n,) that have searched in vain.

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
            self._begun = {
                name: with_rows(self._begun.get(name, values), began, values[began])
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
        """Return the speeds (n,) m/s and turns (n,) rad at ``elapsed`` (n,) s of a search."""
        number, phase = np.divmod(elapsed, self._round)
        look = self._table.look
        steps = (phase > look) & (phase < look + self._back) & (number >= self._first_step)
        speed, turn = -np.where(steps, self._speed, 0.0), np.zeros(len(elapsed))
        if self._rolling:
            rolled = np.clip((phase - 2 * look - self._back) / self._rolling, 0.0, 1.0)
            turn = (number + rolled) * self._turn
        return speed, turn


@dataclass(frozen=True)
class RelocalisationSettings:
    """Extent of relocalisation by pictures.

    A robot that has slipped in a tee is found again, and no value is sharp.

    Attributes:
        reach: m, length of route before and behind a robot that is searched: it slips no farther.
        spacing: m, between the positions compared: about what a pose is corrected by from there.
        check_period: s, between two checks of a robot's turn about its axis before a fitting.
        committed: m, depth of a robot's nose in a fitting from which on it goes on with it.
    """

    reach: float = 1.0
    spacing: float = 0.02
    check_period: float = 1.0
    committed: float = 0.03


RELOCALISATION = RelocalisationSettings()


class Relocaliser:
    """Notices which of n robots have lost their pose, and finds it again by their pictures.

    Args:
        routes: that the robots drive.
        robot: parameters, shared by all.
        localiser: their estimates.

    Attributes:
        lost: (n,) bool, robots that do not know where they are.
    """

    def __init__(self, routes: RouteMap, robot: Robot, localiser: Localiser) -> None:
        self._routes, self._robot, self._localiser = routes, robot, localiser
        n = len(localiser.unknown)
        self.lost, self._checked = np.zeros(n, bool), np.zeros(n)
        self._relocated: list[int] = []

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Begin anew for robots ``rows`` (k,)."""
        set_rows(self, rows, lost=False, _checked=-np.inf)
        self._relocated = [robot for robot in self._relocated if robot not in rows]

    def update_lost(self, location: Location) -> None:
        """Update who is lost.

        A robot is lost whose pictures are not those of the map, or that stands before a fitting and
        does not know well enough how it is turned.

        Args:
            location: estimate, with ``sure``.
        """
        assert location.sure is not None
        # Stepping back from the fitting does not make it know more.
        unsure = ~location.sure & (self._is_before_fitting(location) | self.lost)
        self.lost = self._localiser.inconsistent | unsure

    def check(
        self, location: Location, gear: NDArray[np.int_], time: Array, robots: NDArray[np.bool_]
    ) -> None:
        """Check the estimates of ``robots`` (n,) whose pictures have just arrived.

        Args:
            location: estimate.
            gear: (n,) 1 nose first, -1 tail first.
            time: (n,) s.
            robots: (n,) bool.
        """
        if np.count_nonzero(self._localiser.inconsistent & robots):
            self._look_along_route(location, gear, robots)
        self._check_turns(location, gear, time, robots)

    def _check_turns(
        self, location: Location, gear: NDArray[np.int_], time: Array, robots: NDArray[np.bool_]
    ) -> None:
        """Verify the orientation of robots in front of a fitting, on arrival and then every second.

        A wrong one may be a local minimum that small corrections do not leave.
        """
        shot = self._localiser.shot
        assert shot is not None
        waited = time > self._checked + RELOCALISATION.check_period
        due = robots & self._is_before_fitting(location) & waited & (shot.facing == gear)
        rows = np.flatnonzero(due & ~self._localiser.unknown)
        if len(rows):
            self._checked[rows] = time[rows]
            self._localiser.verify(rows)

    def _is_before_fitting(self, location: Location) -> NDArray[np.bool_]:
        """Return robots (n,) that are about to enter a fitting."""
        room = self._routes.nose_room(location, self._robot.length)
        return (room <= self._robot.standing_room) & (room > -RELOCALISATION.committed)

    def _look_along_route(
        self, location: Location, gear: NDArray[np.int_], robots: NDArray[np.bool_]
    ) -> None:
        """Compare the pictures of inconsistent robots with the map at all poses along the route."""
        localiser, routes = self._localiser, self._routes
        rows = np.flatnonzero(localiser.inconsistent & robots)
        reach, spacing = RELOCALISATION.reach, RELOCALISATION.spacing
        steps = np.arange(-reach, reach + spacing / 2, spacing)
        distance = location.distance[rows, None] + steps  # (m, c)
        route = np.repeat(location.route[rows], len(steps))
        longest = routes.lengths[route].reshape(distance.shape)
        distance = np.clip(distance, 0.0, longest)
        places, frames = [], []
        for turn in localiser.turns.tolist():
            points, frame = routes.poses(route, distance.ravel(), np.full(len(route), turn))
            places.append(points.reshape(len(rows), -1, 3))
            frames.append(frame.reshape(len(rows), -1, 3, 3))
        frame = heading(np.concatenate(frames, axis=1), gear[rows][:, None])
        relocated = localiser.seek(rows, np.concatenate(places, axis=1), frame)
        self._relocated = rows[relocated].tolist()

    def take_nearest(self, route: NDArray[np.intp], near: Array) -> Array:
        """Return arc lengths (n,) m from which locations are searched for next.

        They are those of a moment ago; for robots that have been relocalised since the last call,
        that of the route's point nearest to them.

        Args:
            route: (n,) of the robots.
            near: (n,) m, of a moment ago.
        """
        if self._relocated:
            near = near.copy()
        for robot in self._relocated:
            length = float(self._routes.lengths[route[robot]])
            along = np.arange(0.0, length, RELOCALISATION.spacing)
            points = self._routes.poses(np.full(len(along), route[robot]), along, 0 * along)[0]
            aside = ((points - self._localiser.filter.position[robot]) ** 2).sum(axis=-1)
            near[robot] = along[aside.argmin()]
        self._relocated = []
        return near
