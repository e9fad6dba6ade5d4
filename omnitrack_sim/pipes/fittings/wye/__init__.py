"""A wye: a branch at 45 to 90 degrees to its run, of an equal or a smaller bore."""

from omnitrack_sim.pipes.fittings.wye.fitting import Wye

__all__ = ["Wye"]
