"""Studies: values of a scenario that are best by what its trials show, found by search."""

from omnitrack_sim.trials.optimise.run import StudyResult, StudyStatus, run_study
from omnitrack_sim.trials.optimise.spec import Study, load_study

__all__ = ["Study", "StudyResult", "StudyStatus", "load_study", "run_study"]
