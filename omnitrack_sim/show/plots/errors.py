"""Panels of what a robot takes itself to be, less what it is, with the band that it claims."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.record.metrics import KNOWN
from omnitrack_sim.show.plots.panels import Panel
from omnitrack_sim.show.plots.style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from omnitrack_sim.record.trajectory import Trajectory

BAND = 2.0
"""Half of the band's width, in standard deviations."""
BAND_COLOUR = "#b9cbe4"
_MM, _DEG = 1e3, 180.0 / np.pi
ERRORS = (
    Panel("distance", "Error of the distance", "mm", _MM, span=4.0),
    Panel("theta5", "Error of theta5", "deg", _DEG, span=2.0),
    Panel("tilt", "Error of the tilt", "deg", _DEG, span=2.0),
)
"""By the channel that is estimated."""
_SHOWN = 95.0
"""Part of the times, in percent, at which error and band are seen whole, of those at which the
robot claims to know how it is turned: before, its band is as wide as a circle."""


def has_estimates(trajectory: Trajectory) -> bool:
    """Whether the record is of a robot that drives by its own sensors."""
    return "distance_estimate" in trajectory.channels


def draw_error(axis: Axes, panel: Panel, trajectory: Trajectory) -> None:
    """The error over time, above the band of ``BAND`` standard deviations to either side."""
    error, band = _error(panel, trajectory)
    axis.fill_between(trajectory.time, -band, band, color=BAND_COLOUR, lw=0, zorder=1.5)
    axis.axhline(0.0, color="white", lw=0.6, zorder=1.6)
    axis.plot(trajectory.time, error, color=INK)
    largest = np.maximum(np.abs(error), band)
    sure = trajectory["theta5_std"] < KNOWN
    largest = largest[np.isfinite(largest) & (sure if sure.any() else True)]
    half = 1.1 * float(np.percentile(largest, _SHOWN)) if len(largest) else 0.0
    half = max(half, panel.span / 2)
    axis.set_ylim(-half, half)


def _error(panel: Panel, trajectory: Trajectory) -> tuple[NDArray, NDArray]:
    """Error and half of the band (T,), in the panel's unit."""
    name = panel.channel
    error = trajectory[f"{name}_estimate"] - trajectory[name]
    if panel.unit == "deg":
        error = wrap_angle(error)
    return panel.scale * error, BAND * panel.scale * trajectory[f"{name}_std"]
