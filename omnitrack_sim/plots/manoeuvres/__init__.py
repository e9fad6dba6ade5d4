"""Figures of manoeuvres: one run over time and along the pipe, and comparisons of many runs."""

from omnitrack_sim.plots.manoeuvres.contact_map import NO_CONTACT_FORCE, contact_map_figure
from omnitrack_sim.plots.manoeuvres.curves import along_figure, angular_velocity_figure
from omnitrack_sim.plots.manoeuvres.elbows import SERIES_COLOURS, elbow_figure
from omnitrack_sim.plots.manoeuvres.phases import PHASE_COLOURS, PHASE_NAMES, inner_module
from omnitrack_sim.plots.manoeuvres.rates import rates_figure
from omnitrack_sim.plots.manoeuvres.success import (
    FAILED_COLOUR,
    PASSED_COLOUR,
    SINGULAR_COLOUR,
    success_colours,
    success_figure,
)

__all__ = [
    "FAILED_COLOUR",
    "NO_CONTACT_FORCE",
    "PASSED_COLOUR",
    "PHASE_COLOURS",
    "PHASE_NAMES",
    "SERIES_COLOURS",
    "SINGULAR_COLOUR",
    "along_figure",
    "angular_velocity_figure",
    "contact_map_figure",
    "elbow_figure",
    "inner_module",
    "rates_figure",
    "success_colours",
    "success_figure",
]
