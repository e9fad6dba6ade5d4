"""Sweeps: many trials of a scenario, on all cores or a cluster, into one table."""

from omnitrack_sim.trials.sweep.dispatch import Status
from omnitrack_sim.trials.sweep.engine import run_sweep
from omnitrack_sim.trials.sweep.picture import plot_sweep
from omnitrack_sim.trials.sweep.spec import Sweep, load_sweep

__all__ = ["Status", "Sweep", "load_sweep", "plot_sweep", "run_sweep"]
