"""Figures: of a run, of two, and of networks.

They have one grammar: ``plot_WHAT(what, path=None, *, format=None)`` returns a figure of matplotlib
and writes it where there is a path. Those with one chart take ``ax`` and draw there.
"""

from omnitrack_sim.show.plots.channel import plot_channel
from omnitrack_sim.show.plots.compare import plot_compare
from omnitrack_sim.show.plots.mission import plot_mission
from omnitrack_sim.show.plots.network import plot_network
from omnitrack_sim.show.plots.style import FORMATS, MODULE_COLOURS
from omnitrack_sim.show.plots.summary import plot_summary

__all__ = [
    "FORMATS",
    "MODULE_COLOURS",
    "plot_channel",
    "plot_compare",
    "plot_mission",
    "plot_network",
    "plot_summary",
]
