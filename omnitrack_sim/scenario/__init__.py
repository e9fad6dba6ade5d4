"""Scenarios: what a user writes in a file, validated as a whole before anything runs."""

from omnitrack_sim.scenario.loading import load_scenario, override, read_back, set_value, validate
from omnitrack_sim.scenario.model import Scenario

__all__ = ["Scenario", "load_scenario", "override", "read_back", "set_value", "validate"]
