"""Random tee turns: the trials that several studies and benchmarks share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from omnitrack_sim import Result, Scenario, load_scenario, override


def random_tee_turns(
    count: int,
    *,
    seed: int = 0,
    friction: tuple[float, float] = (0.8, 1.0),
    preload: tuple[float, float] = (15.0, 35.0),
    theta5_deg: float = 11.0,
    changes: Mapping[str, Any] | None = None,
) -> list[Scenario]:
    """Tee turns with theta5 uniform within +-theta5_deg and random gravity.

    Friction and preload, N a module, are uniform in their ranges. The draw of trial i does not
    depend on ``changes``, so that two studies compare the same trials.
    """
    rng = np.random.default_rng(seed)
    base = load_scenario("tee_turn")
    scenarios = []
    for index in range(count):
        gravity = rng.normal(size=3)
        draw = {
            "name": f"tee_turn_{index}",
            "start.theta5_deg": float(rng.uniform(-theta5_deg, theta5_deg)),
            "world.friction": float(rng.uniform(*friction)),
            "robot.preload": float(rng.uniform(*preload)),
            "world.gravity": (9.81 * gravity / np.linalg.norm(gravity)).tolist(),
            "control.align": False,
            "control.retry": False,
        }
        scenarios.append(override(base, draw | dict(changes or {})))
    return scenarios


def summary_line(results: list[Result]) -> str:
    """How many passed, in what time, and how the others ended."""
    passed = [r for r in results if r.success]
    others: dict[str, int] = {}
    for result in results:
        if not result.success:
            others[result.outcome.value] = others.get(result.outcome.value, 0) + 1
    time = f"{np.mean([r.duration_s for r in passed]):.2f} s" if passed else "-"
    ends = ", ".join(f"{count} {name}" for name, count in sorted(others.items())) or "-"
    return f"{len(passed)} of {len(results)} | {time} | {ends}"
