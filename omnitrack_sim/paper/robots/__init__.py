"""Claims of robots, one module each: tuples `MEASURES` that their classes name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from omnitrack_sim.robots.robot import Robot

FACTORS = 0.7, 1.4
"""By which assumed sizes are varied, one at a time."""


def varied(robot: Robot, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return changes of a scenario by which each named parameter of its robot is smaller and
    larger."""
    return [
        {f"robot.{name}": factor * getattr(robot, name)} for name in names for factor in FACTORS
    ]
