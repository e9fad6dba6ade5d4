"""Findings that nothing measured, and runs that nobody drove, for tests of claims."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from omnitrack_sim import Outcome, Result, Scenario, override
from omnitrack_sim.paper.claim import Claim, ClaimVerdict, Finding, Measurement
from omnitrack_sim.sim.run import run

_FOUND = {
    ClaimVerdict.HOLDS: {"holds": True},
    ClaimVerdict.CALIBRATED: {"holds": True, "calibrated": True},
    ClaimVerdict.CONTRADICTION: {"holds": False, "other_holds": True},
    ClaimVerdict.FAILS: {"holds": False},
    ClaimVerdict.STUDY: {"holds": None},
}


def sample_finding(
    verdict: ClaimVerdict,
    expected: ClaimVerdict | None = None,
    measured: str = "1.0 mm",
    quick: bool = False,
    **changes: Any,
) -> Finding:
    """A finding whose claim is expected to come out as it does where nothing else is said."""
    expected = verdict if expected is None else expected
    fields = {"id": "a_b", "source": "Section V", "paper": "says", "statement": "true if"}
    fails = expected in (ClaimVerdict.CONTRADICTION, ClaimVerdict.FAILS)
    why = "it slips" if fails else ""
    found = Measurement(measured, **_FOUND[verdict])
    claim = Claim(
        **{
            **fields,
            "how": "scenario",
            "measure": lambda given: found,
            "expected": expected,
            "why": why,
            **changes,
        }
    )
    return claim(None, quick)


DRIVEN: dict[tuple[str, bool], Result] = {}
"""Runs of each kind of robot, pulled and not."""


def made_up(scenario: Scenario, number: int) -> Result:
    """A run of six seconds all along the route; every third one fails."""
    key = scenario.robot.kind, scenario.pull is not None
    if key not in DRIVEN:
        DRIVEN[key] = run(override(scenario, {"run.time_limit": 0.4}), no_load=False)
    result = DRIVEN[key]
    record, phases = result.trajectory, result.trajectory.phases
    samples = len(record.time)
    channels = dict(record.channels)
    channels["distance"] = np.linspace(0.05, 0.98 * scenario.route.length, samples)
    if "phase" in channels:
        middle = np.abs(np.arange(samples) - samples / 2) < samples / 4
        phases = phases if "tee_turn" in phases else (*phases, "tee_turn")
        channels["phase"] = np.where(middle, phases.index("tee_turn"), 0)
    trajectory = replace(record, time=15 * record.time, channels=channels, phases=phases)
    outcome = Outcome.STALLED if number % 3 == 2 else Outcome.REACHED_GOAL
    return replace(result, scenario=scenario, trajectory=trajectory, outcome=outcome)
