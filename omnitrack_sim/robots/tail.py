"""Force on a robot's tail: what it pulls along the pipe; channels and metrics of it."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.metrics import Metric, Run

TAIL_CHANNELS = (
    Channel(
        "tail_force",
        (),
        "N",
        "force on the robot's tail along the pipe, positive backward",
        "route",
        source="route",
    ),
)
"""Recorded where something pulls at robots' tails."""


def _held(run: Run) -> float:
    """Force at the sample in which the robot was farthest on its last leg, N."""
    leg, distance = run.trajectory["leg"], run.trajectory["distance"]
    # Arc lengths of different legs cannot be compared.
    farthest = np.where(leg == leg[-1], distance, -np.inf).argmax()
    return float(run.trajectory["tail_force"][farthest])


TAIL_METRICS = (
    Metric(
        "pull_held_n",
        "N",
        "force at the tail when the robot was farthest on its last leg: the largest that it still "
        "moved against; of a robot that nothing stopped a lower bound",
        _held,
    ),
    Metric(
        "tail_force_max_n",
        "N",
        "largest force at the tail, also while the robot slid back",
        lambda run: float(run.trajectory["tail_force"].max()),
    ),
)
"""Computed where something pulls at robots' tails."""
