"""Claims of robots other than the omnidirectional one: measured, shown, and as their pages say."""

from __future__ import annotations

import json
import re

import pytest
from commands import omnitrack
from documents import page
from test_robots import Ball

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.paper.claim import Measurement, Sample, claim
from omnitrack_sim.paper.reproduce import measure_robot, reproduce
from omnitrack_sim.paper.robots import claims_of
from omnitrack_sim.robots.kinds import DEFAULT, ROBOTS, robot_class
from omnitrack_sim.scenario import override
from omnitrack_sim.sim.run import run_batch

pytestmark = pytest.mark.long

MEASURED = sorted(kind for kind in set(ROBOTS) - {DEFAULT} if claims_of(robot_class(kind)))


class Roller(Ball):
    """A robot of somebody's own, of which two things are claimed."""

    @classmethod
    def claims(cls):
        return rolls, stops


SAYS = {"source": "nobody", "paper": "says", "statement": "true if", "how": "by hand"}


@claim(**SAYS)
def rolls(quick: bool) -> Measurement:
    return Measurement("3 mm" if quick else "4 mm", True)


@claim(**SAYS)
def stops(quick: bool) -> Measurement:
    return Measurement("5 mm", False)


KIND = "test_robot_claims:Roller"


def test_a_robot_brings_its_claims_by_its_class(tmp_path):
    """They are measured in their order, in the form asked for; the page is the robot's alone."""
    steps: list[tuple[float, str]] = []
    findings = reproduce(
        tmp_path / "a", robot=KIND, quick=True, progress=lambda *step: steps.append(step)
    )
    assert [finding.claim.id for finding in findings] == ["rolls", "stops"]
    assert findings[0].measurement.measured == "3 mm"
    assert all(finding.quick for finding in findings)
    assert steps == [(0.0, "rolls"), (0.5, "stops")]
    data = json.loads((tmp_path / "a" / "claims.json").read_text())
    assert data["provenance"]["form"] == "quick"
    assert [row["changed"] for row in data["claims"]] == [False, True]
    text = (tmp_path / "a" / "report.html").read_text()
    assert f"<h1>{KIND}, reproduced</h1>" in text
    assert "Figures" not in text
    assert measure_robot(KIND)[0].measurement.measured == "4 mm"


def test_a_robot_without_claims_is_refused(tmp_path):
    """Nothing is written, and the command says why."""
    with pytest.raises(InputError, match="has no claims"):
        reproduce(tmp_path / "a", robot="test_robots:Ball")
    done = omnitrack("reproduce", "mjcf", "--out", str(tmp_path / "b"))
    assert done.returncode == 2
    assert "has no claims" in done.stderr
    assert not list(tmp_path.iterdir())


STUDIES = {
    "climber": ("tee", "assumed_sizes"),
    "helix": ("helix_fittings",),
    "screw": ("elbows", "tee", "assumed_sizes"),
}
"""Measures of which nothing is judged: some seconds of their runs tell as much as all."""


@pytest.mark.parametrize("kind", MEASURED)
def test_pages_say_of_claims_what_the_code_gives(kind, monkeypatch):
    """Each claim of a robot stands on its page with the verdict that its quick form comes to, where
    that decides it, and with the figure, where both forms take the same runs."""
    begun: list[str] = []

    def run_all(scenarios):
        if begun[-1] in STUDIES.get(kind, ()):
            scenarios = [override(scenario, {"run.time_limit": 2.0}) for scenario in scenarios]
        return run_batch(scenarios)

    monkeypatch.setattr("omnitrack_sim.paper.claim.run_batch", run_all)
    table = page(kind).partition(f"<!-- made by: claims_{kind} claims -->")[2].partition("<!--")[0]
    cells = [re.split(r" \| ", line.strip("| \n")) for line in table.splitlines() if "|" in line]
    rows = {(source, words): (verdict, figure) for verdict, source, words, figure in cells[2:]}
    findings = measure_robot(kind, quick=True, progress=lambda part, name: begun.append(name))
    assert len(findings) == len(rows)
    for finding in findings:
        claim, measured = finding.claim, finding.measurement.measured
        verdict, figure = rows[claim.source, claim.paper]
        assert not finding.changed, finding.difference
        assert claim.expected == verdict, claim.id
        if claim.sample is Sample.SAME:
            assert alike(measured, figure), (claim.id, measured, figure)


NUMBER = re.compile(r"\d+(?:\.(\d+))?")


def alike(one: str, other: str) -> bool:
    """Return whether two figures have the same words, and numbers equal to 1 % or a unit of their
    last digit: NumPy's BLAS rounds differently on another processor, and a chain of rigid links
    answers to the last bit by some thousandths."""
    if NUMBER.sub("", one) != NUMBER.sub("", other):
        return False
    pairs = zip(NUMBER.finditer(one), NUMBER.finditer(other), strict=True)
    return all(
        abs(float(a[0]) - float(b[0])) <= max(0.01 * float(b[0]), 1.01 * 10 ** -len(b[1] or ""))
        for a, b in pairs
    )


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ("up 43.6, down 46.0 mm/s", "up 43.7, down 46.0 mm/s", True),
        ("up 43.2, down 46.0 mm/s", "up 43.7, down 46.0 mm/s", False),
        ("3 of 4", "3 of 4", True),
        ("3 of 4 mm", "3 of 4", False),
    ],
)
def test_figures_are_alike_to_the_last_digit(one, other, expected):
    """A figure that rounds the other way is the same; another one, or another word, is not."""
    assert alike(one, other) == expected
