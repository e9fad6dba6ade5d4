"""Claims without a measurement, for tests of what shows and counts them."""

from __future__ import annotations

from typing import Any

from omnitrack_sim.paper.claim import Claim, ClaimVerdict


def sample_claim(
    verdict: ClaimVerdict, expected: ClaimVerdict | None = None, **changes: Any
) -> Claim:
    """A claim that is expected to come out as it does where nothing else is said."""
    expected = verdict if expected is None else expected
    fields = {"id": "a_b", "source": "Section V", "paper": "says", "statement": "true if"}
    fields |= {"measured": "1.0 mm", "uncertainty": "one run", "how": "scenario"}
    fails = expected in (ClaimVerdict.CONTRADICTION, ClaimVerdict.FAILS)
    why = "it slips" if fails else ""
    return Claim(**{**fields, "verdict": verdict, "expected": expected, "why": why, **changes})
