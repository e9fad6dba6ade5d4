"""Figures: the summary of a run, and the motion singularity region."""

from omnitrack_sim.plots.singularity import FIGURES, plot_singularity, singularity_figure
from omnitrack_sim.plots.style import FORMATS, MODULE_COLOURS
from omnitrack_sim.plots.summary import PANELS, plot_summary, summary_figure

__all__ = [
    "FIGURES",
    "FORMATS",
    "MODULE_COLOURS",
    "PANELS",
    "plot_singularity",
    "plot_summary",
    "singularity_figure",
    "summary_figure",
]
