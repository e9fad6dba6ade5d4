"""Timeline of a run: a record of each passage of a fitting, its times, slip, forces and energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.trajectory import Trajectory

ROLL_PHASE, RETRY_PHASE = "align", "back_off"
"""Phases in which a robot rolls its modules on the spot, and backs off to try again."""
FORCE_WINDOW = 0.1
"""Length of the running mean of which the least normal force is taken, s.

Single lugs leave the wall all the time, so single samples tell nothing.
"""


class Touch(NamedTuple):
    """Contacts of a robot's k parts that touch the wall, and power of its m motors, over T samples.

    Attributes:
        touching: (T, k) bool.
        force: (T, k) N, normal forces.
        slip_speed: (T, k) m/s.
        slip_ratio: (T, k) slip velocity over the larger of drive's and part's speed; None for parts
            that are not driven.
        power: (T, m) W, of each motor's rotor where it drives.
    """

    touching: NDArray[np.bool_]
    force: Array
    slip_speed: Array
    slip_ratio: Array | None
    power: Array


@dataclass(frozen=True)
class PassageRecord:
    """One passage of a fitting by the robot's centre, on one leg, and what was measured in it.

    A robot that backs out of a fitting and comes again has one record of it, from the first entry
    to the last exit. Means are over the time in the fitting. Slip and forces are of all modules.

    Attributes:
        leg: index of the leg, from 0, as of the channel and in ``Result.legs``; printed tables and
            figures number legs from 1.
        gear: 1 nose first, -1 tail first.
        name: of the part.
        kind: of its fitting.
        manoeuvre: see ``manoeuvre``.
        enter, leave: ports, as the leg's route has them.
        time_enter_s: first sample in it.
        time_leave_s: first sample after it; None if the run ended in it.
        duration_s: time in it, without the time backed out of it; all durations add up to the
            run's.
        theta5_enter_deg: module 1 from the turning direction of this fitting or, in a straight, of
            the next one.
        tilt_max_deg: largest angle between robot axis and centreline.
        tilt_leave_deg: the same at the last sample in it.
        slip_ratio_mean: mean magnitude while in contact; None if no module touched the wall.
        slip_distance_m: belt travel that moved nothing, mean of the modules.
        normal_force_mean_n: mean of the modules over time.
        normal_force_min_n: least value of a module's running mean over ``FORCE_WINDOW``.
        energy_j: mechanical energy of all motors, braking not recovered; all records add up to the
            energy that ``metrics.summarise`` gives.
        rolls: how often the robot began to roll its modules for this fitting, which is the first
            elbow or tee whose bend or opening it had not left, otherwise the one it stood in.
        retries: how often it backed off to try this fitting again.

    Example:
        >>> result = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1}))
        >>> [(passage.name, passage.kind, passage.gear) for passage in result.timeline()]
        [('straight_0', 'straight', 1)]
    """

    leg: int
    gear: int
    name: str
    kind: str
    manoeuvre: str
    enter: str
    leave: str
    time_enter_s: float
    time_leave_s: float | None
    duration_s: float
    theta5_enter_deg: float
    tilt_max_deg: float
    tilt_leave_deg: float
    slip_ratio_mean: float | None
    slip_distance_m: float
    normal_force_mean_n: float
    normal_force_min_n: float
    energy_j: float
    rolls: int
    retries: int


@np.errstate(invalid="ignore", over="ignore")  # of physics that has diverged
def timeline(trajectory: Trajectory, routes: Sequence[Route], touch: Touch) -> list[PassageRecord]:
    """Return a record for each fitting the robot's centre was in, in order of the first entry.

    A roll before a fitting, or a retry, begins while the centre may still be in the fitting before.
    It counts for the fitting ahead that it is for: the first elbow or tee of the leg whose bend or
    opening the centre has not left. Where there is none, or the centre never came into it on that
    leg, it counts where the robot stood. Controllers without these phases have none.

    Args:
        trajectory: the record.
        routes: of each leg, in the order of the channel ``leg``.
        touch: contacts and power in the samples.
    """
    leg, place = trajectory["leg"].astype(int), passage_indices(trajectory, routes)
    group = _offsets(routes)[leg] + place  # (T,) one number for each fitting of each leg
    # A stable order keeps the samples of each fitting in order of time.
    order = np.argsort(group, kind="stable")
    rows_of = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    rows_of.sort(key=lambda rows: rows[0])
    rolls, retries = (
        _counts(trajectory, routes, group, name) for name in (ROLL_PHASE, RETRY_PHASE)
    )
    samples = _Samples(trajectory, touch)
    records = []
    for rows in rows_of:
        first = int(rows[0])
        route = routes[int(leg[first])]
        passage = route.passages[int(place[first])]
        number = int(group[first])
        records.append(
            PassageRecord(
                leg=int(leg[first]),
                gear=-1 if trajectory["gear"][first] < 0 else 1,
                name=route.network.parts[passage.index].name,
                kind=passage.kind,
                manoeuvre=passage.words,
                enter=passage.enter,
                leave=passage.leave,
                **samples.figures(rows),
                rolls=int(rolls[number]),
                retries=int(retries[number]),
            )
        )
    return records


def passage_indices(trajectory: Trajectory, routes: Sequence[Route]) -> NDArray[np.intp]:
    """Return the index of the passage that the robot's centre is in, for each sample (T,).

    It counts along the route of the sample's leg. Before the first port plane it is the first
    passage, beyond the last plane the last one. A sample without a distance is taken to be where
    the sample before it was.
    """
    distance = trajectory["distance"]
    # The number of the last finite sample so far; physics that has diverged has none.
    known = np.maximum.accumulate(np.where(np.isfinite(distance), np.arange(len(distance)), 0))
    distance, leg = distance[known], trajectory["leg"].astype(int)
    place = np.zeros(len(distance), np.intp)
    for index, route in enumerate(routes):
        planes = [passage.s_leave for passage in route.passages[:-1]]
        on = leg == index
        # The end of the last passage is left out: a robot beyond it is still in the last one.
        place[on] = np.searchsorted(planes, distance[on], side="right")
    return place


def phase_starts(trajectory: Trajectory, phase: str) -> NDArray[np.intp]:
    """Return the rows at which a phase begins; none if the controller has no such phase."""
    if phase not in trajectory.phases:
        return np.zeros(0, np.intp)
    inside = trajectory["phase"].astype(int) == trajectory.phases.index(phase)
    return np.flatnonzero(inside & ~np.append(False, inside[:-1]))


def running_mean(values: NDArray, time: Array, window: float) -> Array:
    """Return the centred mean (T, k) of samples, over a window that is shorter at both ends.

    Args:
        values: (T, k) samples.
        time: (T,) s, of the samples.
        window: length of the window, s.
    """
    values = np.asarray(values, float)
    if len(time) < 2:
        return values
    step = np.diff(time)[:, None]
    # Differences of the running integral give every mean at once, whatever the window's length.
    total = np.concatenate(
        [np.zeros((1, values.shape[1])), np.cumsum(step * (values[1:] + values[:-1]) / 2, axis=0)]
    )
    low, high = np.maximum(time - window / 2, time[0]), np.minimum(time + window / 2, time[-1])
    rise = [np.interp(high, time, column) - np.interp(low, time, column) for column in total.T]
    return np.stack(rise, axis=1) / (high - low)[:, None]


class _Samples:
    """Samples that the figures of a passage are computed from.

    Each is the mean over the interval to the next one (trapezoidal rule).
    """

    def __init__(self, trajectory: Trajectory, touch: Touch) -> None:
        touching = touch.touching.astype(float)  # (T, k)
        # Braking gives nothing back to the motors.
        power = np.maximum(touch.power, 0.0)
        force, ratio = touch.force, touch.slip_ratio
        self.has_ratio = ratio is not None
        time = trajectory.time
        self.time = time  # (T,) s
        # The last sample begins no interval: so durations and energies of all passages add up to
        # the run's.
        self.step = np.append(np.diff(time), 0.0)  # (T,) s, interval that begins at each sample
        self.touching = _between(touching.sum(axis=1))
        self.slip = _between((np.abs(0.0 if ratio is None else ratio) * touching).sum(axis=1))
        self.slip_speed = _between(np.abs(touch.slip_speed).mean(axis=1))
        self.power = _between(power.sum(axis=1))
        self.force = _between(force.mean(axis=1))
        self.min_force = running_mean(force, time, FORCE_WINDOW).min(axis=1)
        self.tilt, self.theta5 = (np.degrees(trajectory[name]) for name in ("tilt", "theta5"))

    def figures(self, rows: NDArray[np.intp]) -> dict:
        """Measured fields of the passage of the samples ``rows``, which are in order of time."""
        first, last = int(rows[0]), int(rows[-1])
        step = self.step[rows]
        # A run that ends at its first sample in a fitting spends no time there. The means are then
        # the values of that sample.
        weight = step if step.sum() > 0 else np.ones(len(rows))
        touching = float(weight @ self.touching[rows]) if self.has_ratio else 0.0
        return {
            "time_enter_s": float(self.time[first]),
            "time_leave_s": float(self.time[last + 1]) if last + 1 < len(self.time) else None,
            "duration_s": float(step.sum()),
            "theta5_enter_deg": float(self.theta5[first]),
            "tilt_max_deg": float(self.tilt[rows].max()),
            "tilt_leave_deg": float(self.tilt[last]),
            "slip_ratio_mean": float(weight @ self.slip[rows]) / touching if touching > 0 else None,
            "slip_distance_m": float(step @ self.slip_speed[rows]),
            "normal_force_mean_n": float(weight @ self.force[rows] / weight.sum()),
            "normal_force_min_n": float(self.min_force[rows].min()),
            "energy_j": float(step @ self.power[rows]),
        }


def _between(values: Array) -> Array:
    """Mean (T,) of each sample (T,) and the next one; the last sample stays as it is."""
    return (values + np.append(values[1:], values[-1:])) / 2


def _offsets(routes: Sequence[Route]) -> NDArray[np.intp]:
    """Number of the first fitting of each leg when all legs are counted through, and the total."""
    return np.cumsum([0, *(len(route.passages) for route in routes)])


def _counts(
    trajectory: Trajectory, routes: Sequence[Route], group: NDArray[np.intp], phase: str
) -> NDArray[np.intp]:
    """Count how often a phase began, for each fitting of each leg.

    Args:
        trajectory: of T samples.
        routes: of the legs.
        group: (T,) number of the fitting that each sample is in.
        phase: name of the phase.
    """
    offsets, visited = _offsets(routes), set(group.tolist())
    counts = np.zeros(offsets[-1], np.intp)
    for row in phase_starts(trajectory, phase).tolist():
        leg, distance = int(trajectory["leg"][row]), float(trajectory["distance"][row])
        # The first elbow or tee whose bend or opening ends beyond the robot's centre, if any.
        ahead = (i for i, p in enumerate(routes[leg].passages) if p.span[1] > distance)
        meant = next((int(offsets[leg]) + i for i in ahead), None)
        counts[meant if meant in visited else group[row]] += 1
    return counts
