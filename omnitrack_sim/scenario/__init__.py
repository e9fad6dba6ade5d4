"""Scenarios: files of runs, validated as a whole before anything is simulated."""

from omnitrack_sim.scenario.loading import (
    kinds_first,
    load_scenario,
    override,
    read_back,
    set_value,
    validate,
)
from omnitrack_sim.scenario.model import Scenario

__all__ = [
    "Scenario",
    "kinds_first",
    "load_scenario",
    "override",
    "read_back",
    "set_value",
    "validate",
]
