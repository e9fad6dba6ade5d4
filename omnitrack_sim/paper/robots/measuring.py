"""Runs that claims on robots are measured on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario import load_scenario, override
from omnitrack_sim.sim.run import run_batch


def runs_of(scenario: str, changes: Iterable[Mapping[str, Any]]) -> list[Result]:
    """Return the results of a shipped scenario with each of the ``changes``, whatever it expects.

    Args:
        scenario: its name.
        changes: new values by dotted key, for each run.
    """
    base = load_scenario(scenario, {"run.expected_outcome": None})
    return list(run_batch([override(base, change) for change in changes]))


FACTORS = 0.7, 1.4
"""By which assumed sizes are varied, one at a time."""


def varied(robot: Robot, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return changes of a scenario by which each named parameter of its robot is smaller and
    larger."""
    return [
        {f"robot.{name}": factor * getattr(robot, name)} for name in names for factor in FACTORS
    ]
