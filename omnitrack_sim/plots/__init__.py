"""Figures: the summary and the map of a run, and the motion singularity region."""

from omnitrack_sim.plots.mission import mission_figure, plot_mission
from omnitrack_sim.plots.singularity import FIGURES, plot_singularity, singularity_figure
from omnitrack_sim.plots.style import FORMATS, MODULE_COLOURS
from omnitrack_sim.plots.summary import PANELS, plot_summary, summary_figure

__all__ = [
    "FIGURES",
    "FORMATS",
    "MODULE_COLOURS",
    "PANELS",
    "mission_figure",
    "plot_mission",
    "plot_singularity",
    "plot_summary",
    "singularity_figure",
    "summary_figure",
]
