"""The verdicts of a reproduction: how they follow from numbers, and what tells that one changed."""

import json
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from claim_samples import sample_finding
from samples import sample_result, sample_trajectory
from scipy import stats
from typer.testing import CliRunner

from omnitrack_sim.cli import app
from omnitrack_sim.paper import driving, turns
from omnitrack_sim.paper.claim import (
    ClaimVerdict,
    Measurement,
    Sample,
    claim,
    difference,
    tally,
)
from omnitrack_sim.paper.reproduce import ReportFigure, page
from omnitrack_sim.robots.omnitrack.kinematics import angular_velocity, elbow_speeds
from omnitrack_sim.robots.omnitrack.motors import MOTORS
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.scenario import load_scenario, override

HOLDS, CALIBRATED, CONTRADICTION, FAILS, STUDY = ClaimVerdict


def test_a_contradiction_takes_another_statement_that_comes_out():
    """Only then; a statement that comes out itself holds whatever else the paper says."""
    found = [
        Measurement("", holds, other).verdict for holds, other in product((True, False), repeat=2)
    ]
    assert found == [HOLDS, HOLDS, CONTRADICTION, FAILS]


@pytest.mark.parametrize(
    ("sector", "margin", "verdict"),
    [(96.54, 11.78, CONTRADICTION), (96.54, 11.73, CALIBRATED), (90.0, 11.78, FAILS)],
    ids=["as printed", "as it should be", "both beside it"],
)
def test_the_printed_margin_is_held_against_the_printed_sector(
    sector, margin, verdict, monkeypatch
):
    """11.73 degrees come out. That the paper contradicts itself follows from its two figures."""
    monkeypatch.setattr(driving, "_SECTOR", sector)
    monkeypatch.setattr(driving, "_MARGIN", margin)
    found = driving.singularity_margin({})
    assert found.verdict is verdict
    assert driving.singularity_success_rate({}).verdict is CALIBRATED
    assert found.changed == (verdict is not CONTRADICTION)


def test_what_the_reach_was_inferred_from_does_not_hold(monkeypatch):
    """The reach was inferred from 96.54 degrees, so the sector and both rates come out whatever is
    true: they are calibrated. With another reach they fail."""
    claims = (
        driving.singularity_sector,
        driving.singularity_failure_rate,
        driving.singularity_success_rate,
    )
    for reach, verdict in ((0.0961, CALIBRATED), (0.094, FAILS)):
        monkeypatch.setattr(driving, "TurnCase", partial(TurnCase, reach=reach))
        found = [claim({}) for claim in claims]
        assert [finding.verdict for finding in found] == [verdict] * 3
        assert [finding.changed for finding in found] == [verdict is FAILS] * 3


@pytest.mark.parametrize(
    ("lever", "verdict"),
    [(0.0524, HOLDS), (0.065, HOLDS), (0.072, CONTRADICTION), (0.08, CONTRADICTION), (0.1, FAILS)],
)
def test_the_lever_is_l_or_half_of_the_bore_or_neither(lever, verdict, monkeypatch):
    """Eq. 18 says l = 52.4 mm and Eq. 20 D/2 = 80 mm; which of them comes out makes the verdict."""
    monkeypatch.setattr(driving, "lever_of", lambda results: (lever, lever))
    runs = {f"elbow_{radius}_jacobian": [sample_result()] for radius in (240, 90)}
    assert driving.eq18_jacobian(runs).verdict is verdict


@pytest.mark.parametrize(
    ("lever", "verdict"), [(0.0524, HOLDS), (0.08, CONTRADICTION), (0.12, FAILS)]
)
def test_the_radius_of_curvature_is_that_of_the_bend_by_l_or_half_of_the_bore(lever, verdict):
    """Of robots whose modules run round the bend at some distance from its centre, which is l in
    Eq. 18 and D/2 in Eq. 20; slip that is taken off counts for nothing."""
    runs = {}
    for name, scenario in (("240", "elbow"), ("90", "elbow_short")):
        elbow = override(load_scenario(scenario), {"start.theta5_deg": 20.0})
        bend = elbow.route.passages[1]
        speeds = elbow_speeds(np.full(1, 0.1), np.radians([20.0]), bend.bend_radius, lever)
        record = sample_trajectory(
            distance=np.linspace(0.0, elbow.route.centreline.length, 201),
            wall_speed=np.repeat(speeds + 0.02, 201, axis=0),
            slip_velocity=np.full((201, 3), 0.02),
        )
        runs[f"elbow_{name}_jacobian"] = [sample_result(record, scenario=elbow)] * 2
    assert driving.eq19_radius(runs).verdict is verdict


def test_what_does_not_hold_has_a_reason():
    """The recorded one, or that none is known for a verdict that was not expected; a claim that is
    not expected to hold cannot be made without one."""
    assert sample_finding(FAILS).reason == "it slips"
    assert sample_finding(CONTRADICTION).reason == "it slips"
    for found in (sample_finding(HOLDS, FAILS), sample_finding(STUDY), sample_finding(CALIBRATED)):
        assert found.reason == ""
    assert sample_finding(FAILS, HOLDS).reason == "Not known; expected was: holds."
    for verdict in (CONTRADICTION, FAILS):
        with pytest.raises(ValueError, match="gives no reason"):
            sample_finding(verdict, why="")


def test_a_study_is_not_judged():
    """Neither its verdict nor the expected one can be another."""
    for verdict, expected in ((STUDY, HOLDS), (FAILS, STUDY)):
        with pytest.raises(ValueError, match=f"{expected} came out as {verdict}"):
            sample_finding(verdict, expected)
    assert sample_finding(STUDY, quick=True, sample=Sample.EVERY).decided


@pytest.mark.parametrize(
    ("sample", "changed"),
    [(Sample.SAME, {HOLDS, FAILS}), (Sample.EVERY, {FAILS}), (Sample.AVERAGE, set())],
)
def test_the_quick_form_changes_only_what_its_runs_decide(sample, changed):
    """One of few runs that fails is a change of a claim about all of them; that all of few pass is
    none. In the full form each other verdict is a change."""
    opposite = {HOLDS: FAILS, FAILS: HOLDS}
    for verdict, expected in opposite.items():
        found = sample_finding(verdict, expected, sample=sample)
        assert found.changed
        assert found.difference == f"a_b: expected {expected}, came out {verdict}"
        quick = sample_finding(verdict, expected, sample=sample, quick=True)
        assert quick.changed == (verdict in changed)
        assert quick.difference.endswith("too few runs to decide") == (verdict not in changed)
    assert not sample_finding(FAILS, sample=sample, quick=True).difference


def test_a_difference_is_that_of_pairs_and_turns_round_with_them():
    """What all draws share does not widen the interval: it is SciPy's of paired samples. The other
    way round it has the other sign; a single pair says nothing, and other draws are no pairs."""
    rng = np.random.default_rng(5)
    shared, gain = rng.normal(100, 50, 12), rng.normal(-5, 2, 12)
    one, two = shared + gain, shared
    less = difference(one, two)
    ends = stats.ttest_rel(one, two).confidence_interval()
    assert (less.low, less.high) == pytest.approx((ends.low, ends.high))
    assert less.under
    assert not less.over()
    more = difference(two, one)
    assert (more.low, more.high) == pytest.approx((-less.high, -less.low))
    assert more.over(2.0)
    assert not more.over(6.0)
    assert more.text("mm").startswith(f"{two.mean():.0f} against {one.mean():.0f} mm (")
    single = difference([1.0], [2.0])
    assert not single.under
    assert not single.over()
    with pytest.raises(ValueError, match="have no pairs"):
        difference(one, two[1:])


def test_a_difference_of_noise_is_found_in_one_of_twenty():
    """Of draws without a difference one interval in twenty leaves zero out."""
    rng = np.random.default_rng(6)
    noise = [difference(*rng.exponential(1.0, (2, 12))) for _ in range(1000)]
    share = np.mean([one.under or one.over() for one in noise])
    assert 0.03 < share < 0.07


def slipping(*millimetres: float, **changes: object):
    """Results that slip by so much, all modules together."""
    metrics = sample_result().metrics
    return [
        sample_result(metrics=metrics | {"slip_distance_m": [slip / 3000] * 3}, **changes)
        for slip in millimetres
    ]


@pytest.mark.parametrize(
    ("preferred", "verdict"),
    [((50, 62, 55), HOLDS), ((50, 80, 55), FAILS), ((150, 162, 155), FAILS)],
    ids=["less in each draw", "less on average", "more"],
)
def test_the_preferred_orientation_has_to_slip_less_whatever_the_draws(preferred, verdict):
    """A mean that is less by chance does not count."""
    runs = {"inner_paper": slipping(*preferred), "two_inner_paper": slipping(60, 71, 66)}
    assert turns.preferred_orientation(runs).verdict is verdict


def test_a_finding_says_what_drove_the_runs_that_it_was_measured_on():
    """Controllers and motors of the lists that the claim reads, and of no other."""
    base = sample_result()

    def driven(**changes):
        return [sample_result(scenario=override(base.scenario, changes))]

    runs = {
        "a": driven(**{"control.kind": "paper"}),
        "b": driven(**{"robot.motor": "pololu_1000_hpcb", "robot.drive": "differential"}),
        "c": driven(**{"control.kind": "equal"}),
    }

    @claim(source="s", paper="p", statement="t", how="h")
    def reads(runs):
        return Measurement(str(len(runs["a"]) + len(runs["b"])), True)

    told = reads(runs).driven
    limit = MOTORS["pololu_1000_hpcb"].torque_limit
    assert told == (
        "as written: simulation up to 1.18 N m; feedback with one motor, differential: "
        f"pololu_1000_hpcb up to {limit:.3g} N m"
    )
    assert reads(runs).row()["driven"] == told


def _printed(claims, monkeypatch, *options):
    """Exit status, output and messages of the command where these claims come out."""
    monkeypatch.setattr("omnitrack_sim.paper.reproduce.reproduce", lambda *_, **__: claims)
    done = CliRunner().invoke(app, ["reproduce", *options])
    return done.exit_code, done.stdout, done.stderr.strip()


@pytest.mark.parametrize("options", [(), ("--json",)], ids=["table", "json"])
def test_the_exit_status_is_0_as_expected_and_1_where_a_verdict_changed(options, monkeypatch):
    """Whatever the verdicts are; which one changed stands on standard error."""
    expected = [sample_finding(verdict) for verdict in ClaimVerdict]
    status, _, told = _printed(expected, monkeypatch, *options)
    assert (status, told) == (0, "")
    few = sample_finding(HOLDS, FAILS, id="c_d", sample=Sample.EVERY, quick=True)
    status, _, told = _printed([*expected, few], monkeypatch, *options)
    assert status == 0
    assert "not decided: c_d: expected does not come out, came out holds; the quick" in told
    changed = sample_finding(FAILS, HOLDS, id="e_f")
    status, _, told = _printed([*expected, changed], monkeypatch, *options)
    assert status == 1
    assert "changed: e_f: expected holds, came out does not come out" in told


def test_the_report_shows_verdicts_reasons_and_counts(monkeypatch):
    """Of all kinds."""
    claims = [sample_finding(verdict, id=verdict.name.lower()) for verdict in ClaimVerdict]
    long = sample_finding(HOLDS, id="a_claim_with_a_long_name", measured="1.0 mm " * 60)
    long = replace(long, driven="feedback: a motor")
    _, text, _ = _printed([*claims, long], monkeypatch)
    assert "a_claim_with_a_long_name" in text
    text = " ".join(text.split())
    assert "feedback: a motor" in text
    assert "fails: does not come out. it slips" in text
    assert "contradiction: the paper contradicts itself. it slips" in text
    counts = "holds: 2, calibrated: 1, the paper contradicts itself: 1, does not come out: 1"
    assert f"{counts}, study: 1; out/reproduce/report.html" in text
    assert list(tally(claims).values()) == [1, 1, 1, 1, 1]


def test_claims_go_to_json(monkeypatch):
    """Verdict, the expected one, the reason, and whether it is decided and changed."""
    found = sample_finding(FAILS, HOLDS, sample=Sample.AVERAGE, quick=True, figures=("elbow_90",))
    _, text, _ = _printed([found], monkeypatch, "--json")
    (row,) = json.loads(text)
    assert (row["verdict"], row["expected"]) == ("does not come out", "holds")
    assert (row["decided"], row["changed"]) == (False, False)
    assert row["reason"] == found.reason == "Not known; expected was: holds."
    assert row["figures"] == ["elbow_90"]
    assert {"id", "source", "paper", "statement", "measured", "uncertainty", "how", "note"} < set(
        row
    )


def test_the_page_shows_verdicts_with_reasons_and_figures_with_their_claims():
    """A chip at the claim, in the table and below each figure that shows it; a change stands at the
    top."""
    claims = [
        sample_finding(FAILS, id="slips", figures=("elbow_90",)),
        replace(sample_finding(HOLDS, FAILS, id="turns"), driven="feedback: a motor"),
        sample_finding(STUDY, id="asks"),
    ]
    pictures = [
        ReportFigure(name, name, b"<svg/>", "svg+xml") for name in ("elbow_90", "elbow_240")
    ]
    text = page(claims, pictures, {}, [])
    chip = '<span class="chip fails">does not come out</span>'
    assert text.count(chip) == 3
    assert f'<figcaption>elbow_90<br>{chip}<a href="#slips">slips</a></figcaption>' in text
    assert "<figcaption>elbow_240</figcaption>" in text
    assert "<dt>why</dt><dd>it slips</dd>" in text
    assert text.count("<dt>driven by</dt><dd>feedback: a motor</dd>") == 1
    assert "turns: expected does not come out, came out holds." in text
    assert text.count("<dt>asked</dt>") == 1
    assert text.count("<dt>true if</dt>") == 2


@pytest.mark.parametrize(("lever", "slip"), [(0.05, 0.0), (0.08, 0.01)])
def test_the_lever_fits_module_speeds_to_rotation_in_bends(lever, slip):
    """Of a robot that turns for 2 s and then hardly, and is shaken by single lugs all the while:
    neither the straight nor the shaking counts, and slip that is alike in all modules turns
    nothing."""
    time = np.arange(0.0, 4.0, 0.02)
    rate = np.where(time < 2.0, 0.5, 0.05)  # rad/s, about x
    shake = 0.005 * (-1.0) ** np.arange(len(time))
    half = (np.cumsum(rate) * 0.02 + shake) / 2
    zero = np.zeros_like(half)
    of_unit = np.array(
        [angular_velocity(row, np.zeros(1), 1.0)[0, :2] for row in np.eye(3)[:, None]]
    )
    # In the straight the modules are asked for a turn that the pipe does not let happen.
    asked = np.stack([lever * np.where(time < 2.0, rate, 0.5), zero], axis=-1)
    record = sample_trajectory(
        len(time),
        float(time[-1]),
        quaternion=np.stack([np.cos(half), np.sin(half), zero, zero], axis=-1),
        wall_speed=asked @ np.linalg.pinv(of_unit) + slip,
        slip_velocity=np.full((len(time), 3), slip),
    )
    assert driving.lever_of([sample_result(record)]) == pytest.approx((lever, lever), rel=0.05)
