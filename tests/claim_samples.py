"""Findings that nothing measured, for tests of what shows and counts them."""

from __future__ import annotations

from typing import Any

from omnitrack_sim.paper.claim import Claim, ClaimVerdict, Finding, Measurement

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
