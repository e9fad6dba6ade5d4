"""Why the omnidirectional robot makes no headway, by averages of what its tracks do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.diagnosis import Diagnosis, Motion
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.sensor import moments_together, read_together
from omnitrack_sim.robots.size import GRAVITY

# Rows of the averages that the cause of a failure is read from.
NORMAL_FORCE, SLIP_RATIO, SATURATED, BELT_SPEED, BELT_COMMAND, ROLL_COSINE = range(6)


class TrackDiagnosis(Diagnosis):
    """Finds the causes for which n robots make no headway; see ``Diagnosis``.

    Args:
        robot: its length is a unit of the limits.
        limits: see ``[monitor]`` in docs/reference/scenarios.md.
        period: s, between two samples.
        robots: the parameters of each, whose weights are units of the limits.
    """

    def __init__(self, robot: Omnitrack, limits: Any, period: float, robots: Sequence[Any]) -> None:
        super().__init__(robot, limits, period, robots)
        n = self.n
        self._period, self._memory = period, limits.memory * robot.time_scale
        self._exit = robot.length / 2
        self._samples = np.zeros(n, int)
        self._mean = np.zeros((n, 6, 3))
        self._together = moments_together(n)
        # Readings, command of the belts, saturated motors and robots that a sample is due of.
        self._pending: list[tuple[Mapping[str, Array], Array, NDArray, NDArray[np.bool_]]] = []

    def reset(self, rows: NDArray[np.intp]) -> None:
        """See ``Diagnosis``."""
        self._add_up()
        self._mean[rows], self._samples[rows] = 0.0, 0

    def average(
        self,
        readings: Mapping[str, Array],
        command: Any,
        saturated: NDArray[np.bool_],
        due: NDArray[np.bool_],
    ) -> None:
        """See ``Diagnosis``; samples are added up some at a time, or when a cause is asked for."""
        self._pending.append((readings, command.belt_speed, saturated, due))
        if len(self._pending) == self._together:
            self._add_up()

    @property
    def mean(self) -> Array:
        """Averages (n, 6, 3) that the cause of a failure is read from, by the rows above."""
        self._add_up()
        return self._mean

    def _add_up(self) -> None:
        """Add the pending samples to the averages."""
        if not self._pending:
            return
        moments, commands, saturated, dues = zip(*self._pending, strict=True)
        self._pending = []
        read_together(moments, ("normal_force", "slip_ratio", "belt_speed", "roll"))

        def each(name: str) -> Array:
            return np.array([readings[name] for readings in moments])

        command, due = np.array(commands), np.array(dues)
        sample = np.empty((len(moments), *self._mean.shape))  # (k, n, 6, 3)
        sample[:, :, NORMAL_FORCE] = each("normal_force")
        sample[:, :, SLIP_RATIO] = np.abs(each("slip_ratio"))
        sample[:, :, SATURATED] = saturated
        sample[:, :, BELT_SPEED] = each("belt_speed") * np.sign(command)
        sample[:, :, BELT_COMMAND] = np.abs(command)
        sample[:, :, ROLL_COSINE] = np.abs(np.cos(each("roll")))
        count = self._samples + due.cumsum(axis=0)
        self._samples = count[-1]
        # A plain mean until the memory is full.
        part = np.maximum(self._period / self._memory, 1 / np.maximum(count, 1))
        weight = np.where(due, part, 0.0)[..., None, None]
        for i in range(len(sample)):
            self._mean += weight[i] * (sample[i] - self._mean)

    def cause(
        self,
        robot: int,
        location: Location,
        routes: RouteMap,
        retreat: Motion | None,  # noqa: ARG002 - protocol
    ) -> Outcome:
        """See ``Diagnosis``; slip ratios tell whether it slides."""
        if self.lies_across(robot, location):
            return Outcome.WEDGED
        mean, limits, passage = self.mean[robot], self.limits, int(location.passage[robot])
        running = limits.stalled_speed * mean[BELT_COMMAND]
        # At its limit and slower than asked: a motor that only works hard is not stalled.
        stalled = (mean[SATURATED] > 0.5) & (mean[BELT_SPEED] < running)
        # First, for there both tracks of a module work against each other: motors may stall, belts
        # slip.
        if (mean[ROLL_COSINE] < limits.no_motion_cosine).all():
            return Outcome.NO_MOTION_LINE
        turning = routes.is_tee_turn[passage]
        begun = location.distance[robot] > routes.start[passage] - self._exit
        lost_contact = limits.lost_contact * self.robots[robot].mass * GRAVITY
        if turning and begun and mean[NORMAL_FORCE].min() < lost_contact:
            return Outcome.MOTION_SINGULARITY
        if stalled.any():
            return Outcome.STALLED
        # The median of the three: one module alone may spin without a wall.
        if np.sort(mean[SLIP_RATIO])[1] > limits.slipping_ratio:
            return Outcome.SLIPPING
        return Outcome.STUCK

    def motion(
        self,
        robot: int,  # noqa: ARG002 - protocol
        readings: Mapping[str, Array],  # noqa: ARG002
        speed: float,  # noqa: ARG002
    ) -> Motion:
        """See ``Diagnosis``; tracks that press the wall from three sides do not fall."""
        return Motion.SLIDING

    def words(
        self,
        robot: int,
        readings: Mapping[str, Array],
        speed: float,  # noqa: ARG002 - protocol
    ) -> str:
        """See ``Diagnosis``."""
        mean = self.mean[robot]
        forces = ", ".join(f"{force:.1f}" for force in mean[NORMAL_FORCE])
        slips = ", ".join(f"{slip:.2f}" for slip in mean[SLIP_RATIO])
        return (
            f", normal force {forces} N, slip ratio {slips} "
            f"(means of the last {min(self._memory, readings['time'][robot]):.2g} s)"
        )
