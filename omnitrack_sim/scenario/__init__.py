"""Scenarios: what a user writes in a file, validated as a whole before anything runs."""

from omnitrack_sim.scenario.model import Scenario
from omnitrack_sim.scenario.reading import load_scenario, override, read_back, set_value, validate

__all__ = ["Scenario", "load_scenario", "override", "read_back", "set_value", "validate"]
