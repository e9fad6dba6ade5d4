"""A run drawn into its pipes: slip and normal force along the way, and what happened when."""

from omnitrack_sim.plots.mission.figure import mission_figure, plot_mission

__all__ = ["mission_figure", "plot_mission"]
