"""Every claim of a robot can be measured, in the quick form by some of the runs of the full one.

The runs are made up: each robot drives for half a second, and its record counts for every run.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import pytest
from claim_samples import made_up

from omnitrack_sim import Result, Scenario
from omnitrack_sim.paper import claim, experiments, measured, reproduce
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


@pytest.mark.parametrize("kind", [*ROBOTS_WITH_CLAIMS, reproduce.LEDGER])
def test_runs_of_the_quick_form_are_some_of_those_of_the_full_one(kind, asked):
    """Each claim says what it has measured, in numbers; the full form has more runs."""
    hashes = []
    for quick in (True, False):
        forget()
        asked.clear()
        findings = reproduce.measure_robot(kind, quick)
        assert all(any(map(str.isdigit, one.measurement.measured)) for one in findings)
        assert not [one for one in findings if "nan" in one.measurement.measured]
        assert all(one.quick is quick for one in findings)
        hashes.append([scenario.hash for scenario in asked])
        rows = [one.row() for one in findings]
        assert all(row["id"] and row["paper"] and row["statement"] for row in rows)
    few, many = hashes
    assert set(few) <= set(many)
    assert len(few) < len(many)
