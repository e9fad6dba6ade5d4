"""What a robot that drives by its own sensors takes itself to be: channels beside the truth, and
metrics of how far it was right."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.record.channels import Channel, Vector
from omnitrack_sim.record.metrics import Metric, Run


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
    _estimate("distance_std", "m", "standard deviation of `distance_estimate`"),
    _estimate("theta5_estimate", "rad", "what the robot takes its `theta5` for"),
    _estimate("theta5_std", "rad", "standard deviation of `theta5_estimate`"),
    _estimate("tilt_estimate", "rad", "what the robot takes its `tilt` for"),
    _estimate("tilt_std", "rad", "standard deviation of `tilt_estimate`"),
    _estimate(
        "misfit",
        "1",
        "median error of the last picture's pixels against the map, in their standard deviations",
    ),
)
"""Recorded beside the shipped channels where a robot drives by its own sensors."""
KNOWN = 0.35
"""Standard deviation of theta5, rad, up to which the robot claims to know it."""


def _travelled(run: Run) -> float:
    """Way of the robot's centre, m."""
    steps = np.diff(run.trajectory.channels["position"], axis=0)
    return float(np.sqrt((steps**2).sum(axis=-1)).sum())


def _position_error(run: Run) -> np.ndarray:
    found = run.trajectory.channels
    return np.linalg.norm(found["position_estimate"] - found["position"], axis=-1)


def _localisation_error(run: Run) -> float:
    way = _travelled(run)
    return float(np.percentile(_position_error(run), 95) / way) if way > 0 else float("nan")


def _theta5_error(run: Run) -> float:
    found = run.trajectory.channels
    error = np.abs(wrap_angle(found["theta5_estimate"] - found["theta5"]))
    known = found["theta5_std"] < KNOWN
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
