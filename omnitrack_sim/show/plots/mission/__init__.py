"""A run drawn into its pipes: slip and normal force along the way, and what happened when."""

from omnitrack_sim.show.plots.mission.figure import plot_mission

__all__ = ["plot_mission"]
