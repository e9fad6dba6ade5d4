"""Every claim of a robot can be measured, in the quick form by some of the runs of the full one.

The runs are made up: each robot drives for half a second, and its record counts for every run.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from claim_samples import made_up

from omnitrack_sim import Result, Scenario
from omnitrack_sim.paper import claim, experiments, measured, reproduce
from omnitrack_sim.paper.claim import Measurement
from omnitrack_sim.paper.robots import claims_of
from omnitrack_sim.robots.kinds import DEFAULT, ROBOTS, robot_class

ROBOTS_WITH_CLAIMS = sorted(
    kind for kind in set(ROBOTS) - {DEFAULT} if claims_of(robot_class(kind))
)


@pytest.fixture
def asked(monkeypatch) -> Iterator[list[Scenario]]:
    """Scenarios that claims have run, in the place of which made-up runs come."""
    scenarios: list[Scenario] = []

    def run_batch(given: list[Scenario], **options: Any) -> list[Result]:
        scenarios.extend(given)
        return [made_up(scenario, number) for number, scenario in enumerate(given)]

    for module in (claim, experiments, measured):
        monkeypatch.setattr(module, "run_batch", run_batch)
    forget()
    yield scenarios
    forget()


def forget() -> None:
    """Leave no made-up run to what is measured later."""
    for name, module in list(sys.modules.items()):
        if name.startswith("omnitrack_sim.paper"):
            for value in vars(module).values():
                if hasattr(value, "cache_clear"):
                    value.cache_clear()


def counts_of(found: Measurement) -> list[int]:
    """How many runs, draws or cases a measurement says that it is of."""
    text = f"{found.measured}; {found.uncertainty}"
    pattern = r"\bof (\d+)\b|\b(\d+) (?:draws|runs|cases|trials)"
    return [int(of or number) for of, number in re.findall(pattern, text)]


@pytest.mark.parametrize("kind", [*ROBOTS_WITH_CLAIMS, reproduce.LEDGER])
def test_runs_of_the_quick_form_are_some_of_those_of_the_full_one(kind, asked):
    """Of each claim, which says what it has measured, in numbers; some have more of them there."""
    claims = measured.ENTRIES if kind == reproduce.LEDGER else claims_of(robot_class(kind))
    more = 0
    for one in claims:
        forms = []
        for quick in (True, False):
            forget()
            asked.clear()
            found = one(quick, quick)
            told = found.measurement
            assert any(map(str.isdigit, told.measured)), one.id
            assert "nan" not in told.measured, one.id
            assert found.quick is quick
            assert found.row()["measured"] == told.measured
            forms.append(({scenario.hash for scenario in asked}, counts_of(told)))
        (few, few_counts), (many, many_counts) = forms
        assert few <= many, one.id
        assert len(few_counts) <= len(many_counts), one.id
        assert all(a <= b for a, b in zip(few_counts, many_counts, strict=False)), one.id
        more += few_counts < many_counts or few < many
    assert more
