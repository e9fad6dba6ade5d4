"""Metrics of a run, computed from its trajectory; channels and metrics of a robot's estimates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.record.channels import Channel, Vector
from omnitrack_sim.record.trajectory import Trajectory

Figure = float | list[float] | dict[str, float]
Metrics = dict[str, Figure]


@dataclass(frozen=True)
class Run:
    """Data of a run that metrics are computed from.

    Attributes:
        trajectory: the record.
        weight: N, of the robot.
    """

    trajectory: Trajectory
    weight: float = math.nan

    @property
    def duration(self) -> float:
        """Simulated seconds."""
        return float(self.trajectory.time[-1] - self.trajectory.time[0])

    def integral(self, values: NDArray) -> NDArray[np.float64]:
        """Integral over time (...,) of samples (T, ...), by the trapezoidal rule."""
        return np.trapezoid(values, self.trajectory.time, axis=0)

    def mean(self, values: NDArray) -> NDArray[np.float64]:
        """Mean over time (...,) of samples (T, ...); the sample itself where there is only one."""
        return (
            self.integral(values) / self.duration
            if self.duration > 0
            else np.asarray(values[0], float)
        )

    @cached_property
    def travelled(self) -> float:
        """Headway along the route from beginning to end of each leg, added up, m."""
        distance, leg = self.trajectory["distance"], self.trajectory["leg"]
        # Each leg has its own route, so arc lengths of different legs cannot be subtracted.
        ends = np.append(np.flatnonzero(np.diff(leg)), len(leg) - 1)
        starts = np.append(0, ends[:-1] + 1)
        return float((distance[ends] - distance[starts]).sum())

    def rms(self, values: NDArray) -> list[float]:
        """Root mean square over time of samples (T, modules)."""
        return np.sqrt(self.mean(values**2)).tolist()


@dataclass(frozen=True)
class Metric:
    """One figure of a run.

    Attributes:
        name: key in ``result.metrics``; it ends in its unit.
        unit: "1" for numbers without one; "deg" for angles, in which people read them.
        meaning: one line for the docs: thresholds, what it is divided by, what its sign means.
        compute: from a ``Run`` to a number, or a list of one number a module.
        per_module: it is a list.
        in_tables: it is a column of the tables of sweeps.
        title: name for people, of those that consoles, notebooks and pages show.
        digits: after the point, there.

    Example:
        >>> def fastest(run):
        ...     return float(abs(run.trajectory["belt_speed"]).max())
        >>> metric = ot.Metric("belt_speed_max_m_s", "m/s", "fastest belt", fastest)
        >>> scenario = ot.load_scenario("straight", {"run.time_limit": 0.1})
        >>> "belt_speed_max_m_s" in ot.run(scenario, metrics=[metric]).metrics
        True
    """

    name: str
    unit: str
    meaning: str
    compute: Callable[[Any], Figure]
    per_module: bool = False
    in_tables: bool = True
    title: str = ""
    digits: int = 3


def _phase_times(run: Run) -> dict[str, float]:
    times: dict[str, float] = {}
    for name, start, end in run.trajectory.phase_spans():
        times[name] = times.get(name, 0.0) + end - start
    return times


def _work(run: Run) -> float:
    """Work of all actuators, J."""
    return float(run.integral(np.maximum(run.trajectory["actuator_power"], 0.0)).sum())


def _slip_distance(run: Run) -> float:
    """Mean distance, m, that the bodies which touch the wall slip on it."""
    touching = run.trajectory["wall_force"].max(axis=0, initial=0.0) > 0
    slip = run.integral(run.trajectory["contact_speed"])[touching]
    return float(slip.mean()) if len(slip) else 0.0


MOTION: tuple[Metric, ...] = (
    Metric(
        "distance_m",
        "m",
        "headway along the centreline from start to end of each leg, added up; backing off takes "
        "away from it",
        lambda r: r.travelled,
        title="distance",
        digits=3,
    ),
    Metric(
        "mean_speed_m_s",
        "m/s",
        "`distance_m` over the simulated time; 0 where there is only one sample",
        lambda r: r.travelled / r.duration if r.duration > 0 else 0.0,
        title="mean speed",
        digits=4,
    ),
    Metric(
        "tilt_max_deg",
        "deg",
        "largest angle between the robot axis and the centreline's tangent at the robot's centre",
        lambda r: float(np.degrees(r.trajectory["tilt"].max())),
        title="largest tilt",
        digits=1,
    ),
    Metric(
        "tilt_exit_deg",
        "deg",
        "the same angle in the last sample",
        lambda r: float(np.degrees(r.trajectory["tilt"][-1])),
    ),
)
PHASE_TIME = Metric(
    "phase_time_s",
    "s",
    "time in each phase of the controller: a table by the names of the phases",
    _phase_times,
    in_tables=False,
)
COMMON_METRICS: tuple[Metric, ...] = (
    *MOTION,
    Metric(
        "energy_j",
        "J",
        "mechanical work of all actuators: the positive part of each one's power, integrated; "
        "braking gives nothing back",
        _work,
        title="energy",
        digits=1,
    ),
    Metric(
        "cost_of_transport",
        "1",
        "`energy_j` over the robot's weight and `distance_m`; not a number without headway",
        lambda r: _work(r) / (r.weight * r.travelled) if r.travelled > 0 else math.nan,
    ),
    Metric(
        "wall_force_max_n",
        "N",
        "largest force between the wall and one body of the robot",
        lambda r: float(r.trajectory["wall_force"].max(initial=0.0)),
        title="largest force on the wall",
        digits=1,
    ),
    Metric(
        "wall_force_sum_mean_n",
        "N",
        "sum of the sizes of the forces between the wall and each body, mean over time: with many "
        "bodies it is more than `wall_force_max_n`, which is of one body",
        lambda r: float(r.mean(r.trajectory["wall_force"].sum(axis=1))),
    ),
    Metric(
        "slip_distance_mean_m",
        "m",
        "speed over the wall of each body's surface where it touches, integrated; mean of the "
        "bodies that touch at all",
        _slip_distance,
    ),
    PHASE_TIME,
)
"""Metrics of every other robot, in the order of ``result.json``."""


def summarise(run: Run, metrics: Iterable[Metric]) -> Metrics:
    """Compute the figures of a run by the names of ``metrics``.

    Means are over time, by the trapezoidal rule. Slip counts only where a module touches the wall.

    Raises:
        ValueError: a metric gives a list and does not say ``per_module``, or the other way round.
    """
    return {metric.name: _figure(metric, run) for metric in metrics}


def _figure(metric: Metric, run: Run) -> Figure:
    value: Any = metric.compute(run)
    # Files hold plain numbers and lists; a user's own metric may return NumPy's.
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    # Tables of sweeps need to know beforehand how many columns a metric takes.
    if isinstance(value, list) != metric.per_module:
        kind, wanted = type(value).__name__, metric.per_module
        raise ValueError(f"metric {metric.name!r} gives a {kind}, and per_module is {wanted}")
    return value


def _estimate(name: str, unit: str, meaning: str) -> Channel:
    return Channel(name, (), unit, meaning, "route", source="estimate")


ESTIMATES = (
    Vector(
        "position_estimate",
        (3,),
        "m",
        "where the robot takes its centre to be",
        "world",
        source="estimate",
    ),
    _estimate("distance_estimate", "m", "what the robot takes its `distance` for"),
    _estimate(
        "distance_std", "m", "standard deviation of `distance_estimate` on its map, right or not"
    ),
    _estimate(
        "theta5_estimate", "rad", "what the robot takes its `theta5` for, before the same fitting"
    ),
    _estimate("theta5_std", "rad", "standard deviation of `theta5_estimate`"),
    _estimate("tilt_estimate", "rad", "what the robot takes its `tilt` for"),
    _estimate(
        "tilt_std",
        "rad",
        "standard deviation of `tilt_estimate` on its map, towards where it is largest",
    ),
    _estimate(
        "misfit",
        "1",
        "median error of the last picture's pixels against the map, in their standard deviations",
    ),
)
"""Recorded beside the shipped channels where a robot drives by its own sensors."""
MAX_KNOWN_STD = 0.35
"""Standard deviation of theta5, rad, up to which the robot claims to know it."""


def _position_error(run: Run) -> np.ndarray:
    channels = run.trajectory.channels
    return np.linalg.norm(channels["position_estimate"] - channels["position"], axis=-1)


def _localisation_error(run: Run) -> float:
    # Dead reckoning errs in proportion to the path, so the error is stated as a part of it: over
    # positions, not arc lengths, which jump from leg to leg.
    steps = np.diff(run.trajectory["position"], axis=0)
    path = float(np.sqrt((steps**2).sum(axis=-1)).sum())
    return float(np.percentile(_position_error(run), 95) / path) if path > 0 else float("nan")


def _theta5_error(run: Run) -> float:
    channels = run.trajectory.channels
    error = np.abs(wrap_angle(channels["theta5_estimate"] - channels["theta5"]))
    # In a round pipe nothing tells theta5: only what the robot claims to know can be held against
    # it.
    known = channels["theta5_std"] < MAX_KNOWN_STD
    return float(np.degrees(np.percentile(error[known], 95))) if known.any() else float("nan")


ESTIMATE_METRICS = (
    Metric(
        "localisation_error_rel",
        "1",
        "95th percentile over time of the distance between the place that the robot took itself to "
        "be at and the true one, over the length of its whole way",
        _localisation_error,
    ),
    Metric(
        "localisation_error_max_m",
        "m",
        "the largest such distance",
        lambda run: float(_position_error(run).max()),
    ),
    Metric(
        "localisation_error_mean_m",
        "m",
        "its mean over time",
        lambda run: float(run.mean(_position_error(run))),
    ),
    Metric(
        "theta5_error_p95_deg",
        "deg",
        "95th percentile over time of the error of theta5, where the robot claims to know it (to "
        "20 degrees)",
        _theta5_error,
    ),
)
"""Computed beside the shipped metrics where a robot drives by its own sensors."""
