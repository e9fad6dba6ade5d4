"""The benchmark of controllers: the same held-out trials for all of them, into one table."""

from omnitrack_sim.trials.bench.entries import Entry, entry_of, shipped_entries
from omnitrack_sim.trials.bench.run import Bench, run_bench
from omnitrack_sim.trials.bench.tasks import TASKS, Task

__all__ = ["TASKS", "Bench", "Entry", "Task", "entry_of", "run_bench", "shipped_entries"]
