"""Figures: of a run, of two, of networks and of the motion singularity region.

They have one grammar: ``plot_WHAT(what, path=None, *, format=None)`` returns a figure of matplotlib
and writes it where there is a path. Those with one chart take ``ax`` and draw there.
"""

from omnitrack_sim.plots.channel import plot_channel
from omnitrack_sim.plots.compare import plot_compare
from omnitrack_sim.plots.mission import plot_mission
from omnitrack_sim.plots.network import plot_network
from omnitrack_sim.plots.singularity import FIGURES, plot_singularity
from omnitrack_sim.plots.style import FORMATS, MODULE_COLOURS
from omnitrack_sim.plots.summary import plot_summary

__all__ = [
    "FIGURES",
    "FORMATS",
    "MODULE_COLOURS",
    "plot_channel",
    "plot_compare",
    "plot_mission",
    "plot_network",
    "plot_singularity",
    "plot_summary",
]
