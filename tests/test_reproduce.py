"""The reproduction: which runs, how claims are measured on them, and the page."""

import html.parser
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from claim_samples import made_up, sample_finding
from samples import sample_result

from omnitrack_sim import Outcome, load_scenario, override
from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.paper import claim as readings
from omnitrack_sim.paper import driving, experiments
from omnitrack_sim.paper import reproduce as command
from omnitrack_sim.paper.claim import ClaimVerdict
from omnitrack_sim.paper.experiments import (
    GRAVITIES,
    PRESET,
    min_preload,
    random_tee_turns,
    run_all,
    scenarios,
)
from omnitrack_sim.paper.region import plot_singularity
from omnitrack_sim.paper.reproduce import ReportFigure, by_friction, page, preferred
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.show.plots.style import PictureWarning
from omnitrack_sim.sim.run import run_batch

FINDING = sample_finding(ClaimVerdict.HOLDS, paper='says <b> & "c"')


@pytest.fixture(scope="module")
def quick():
    """The lists of the quick form."""
    return scenarios(quick=True)


@pytest.fixture(scope="module")
def runs(quick):
    """Its short runs, and two tee turns."""
    names = (
        "vertical_climb",
        "rolled_past_180",
        "no_motion_line",
        "tee_turn_misaligned",
        "rolling_upright",
        "rolling_flat",
        "bores",
        "straights",
    )
    return run_all({name: quick[name] for name in names})


def test_runs_of_all_lists_are_told_as_one(monkeypatch):
    """How many there are at once, then what the batch tells; each list gets its own back."""
    told = []

    def run(flat, progress, **_):
        progress(0.5, "half")
        return [f"run of {one}" for one in flat]

    monkeypatch.setattr(experiments, "run_batch", run)
    found = run_all({"a": ["x", "y"], "b": [], "c": ["z"]}, lambda *given: told.append(given))
    assert told == [(0.0, "3 runs"), (0.5, "half")]
    assert found == {"a": ["run of x", "run of y"], "b": [], "c": ["run of z"]}


def test_the_quick_form_is_a_part_of_the_full_one(monkeypatch):
    """The same lists, and every run of the quick form is one of the full form, which has 60
    orientations for both controllers and 200 random trials."""

    def draft(base, changes):
        # To check two thousand scenarios would take seconds.
        return (base if isinstance(base, dict) else {"base": base.hash}) | changes

    monkeypatch.setattr(experiments, "override", draft)
    quick, full = scenarios(quick=True), scenarios(quick=False)
    assert quick.keys() == full.keys()
    assert len(full["aligned"]) == len(full["slippery"]) == 200
    for kind in ("jacobian", "paper"):
        theta5 = [run["start.theta5_deg"] for run in full[f"map_{kind}"]]
        assert np.allclose(np.diff(theta5), 2)
        assert len(theta5) == 60
    for name, group in quick.items():
        few, all_runs = (
            {getattr(run, "hash", str(run)) for run in runs} for runs in (group, full[name])
        )
        assert few <= all_runs, name


def test_lists_that_are_compared_share_their_draws(quick):
    """Friction, preload, walls and how far a start is off its orientation are those of the other
    list, pair by pair; both kinds of walls occur."""
    pairs = [
        ("inner_jacobian", "two_inner_jacobian"),
        ("inner_paper", "two_inner_paper"),
        ("inner_paper", "inner_preset"),
        ("rolling_flat", "rolling_upright"),
        ("straight_over_aligned", "straight_over_unaligned"),
        ("elbow_240_paper", "elbow_240_equal"),
    ]
    for one, other in pairs:
        assert {s.physics.collider for s in quick[one]} == {"exact", "primitives"}
        for a, b in zip(quick[one], quick[other], strict=True):
            assert a.world.friction == b.world.friction, (one, other)
            assert (a.robot.preload, a.physics) == (b.robot.preload, b.physics), (one, other)
            off = (a.start.theta5_deg - b.start.theta5_deg) % 60
            assert off == pytest.approx(0, abs=1e-9) or off == pytest.approx(60), (one, other)


def test_speeds_set_beforehand_are_those_of_the_preferred_orientation():
    """A few degrees beside it, and for the module that faces the inside, whichever it is; the
    paper's own controller takes those of the orientation that it has."""
    angles = (0.0, 4.0, -4.0, 116.0)
    beside = {"start.distance": 0.22, "run.time_limit": 0.3, "control.kind": "paper"}
    base = load_scenario("elbow_short", beside)
    put = [override(base, {"start.theta5_deg": angle}) for angle in angles]
    own, preset = (
        [_turn_speeds(result) for result in run_batch([override(s, kind) for s in put])]
        for kind in ({}, PRESET)
    )
    for speeds, inner in zip(preset, (0, 0, 0, 2), strict=True):
        assert speeds == pytest.approx(np.roll(own[0], inner), abs=1e-3)
    assert all(np.abs(own[k] - preset[k]).max() > 1e-3 for k in (1, 2, 3))


def _turn_speeds(result):
    """Belt speeds (3,) m/s that are asked for in the bend."""
    trajectory = result.trajectory
    bend = trajectory["phase"] == trajectory.phases.index("elbow")
    return trajectory["belt_speed_command"][bend][-1]


def test_random_trials_repeat_and_cover_all_gravities():
    """Same draw twice; friction within its range; all six gravities and both signs of theta5
    occur."""
    base = load_scenario("tee_turn")
    first, again = (random_tee_turns(base, 60, (0.8, 1.0)) for _ in range(2))
    assert [s.hash for s in first] == [s.hash for s in again]
    assert {s.world.gravity for s in first} == set(GRAVITIES.values())
    assert all(0.8 <= s.world.friction <= 1.0 and s.control.align for s in first)
    assert (
        min(s.start.theta5_deg for s in first) < -40 < 40 < max(s.start.theta5_deg for s in first)
    )


def test_claims_of_driving_hold(runs):
    """Climb, mean speed, opposite motion, no-motion line, sign change, unequal arms."""
    claims = (
        driving.vertical_climb,
        driving.eq9_mean_speed,
        driving.opposite_motion_past_180,
        driving.no_motion_line,
        driving.sign_change_after_alignment,
    )
    for claim in (*claims, driving.eq8_unequal_arms, driving.bore_compliance):
        found = claim(runs)
        assert found.verdict is ClaimVerdict.HOLDS, found
        assert not found.changed, found
        assert found.claim.how


ELSEWHERE = {"eq8_unequal_arms", "eq18_jacobian", "sign_change_after_alignment"}
"""Claims about rolls and bends, measured on true runs or on rotations in other tests."""


def test_every_claim_can_be_measured_and_every_figure_drawn(quick):
    """Whatever the runs are: each claim tells a number, and what drove the runs that it reads."""
    runs = {
        name: [made_up(scenario, number) for number, scenario in enumerate(scenarios)]
        for name, scenarios in quick.items()
    }
    for claim in command.CLAIMS:
        if claim.id in ELSEWHERE:
            continue
        found = claim(runs, True)
        assert any(map(str.isdigit, found.measurement.measured)), claim.id
        assert "Result(" not in found.measurement.measured, claim.id
        assert found.driven or claim.id.startswith("singularity_"), claim.id
    for name, (caption, draw) in command.FIGURES.items():
        assert caption
        assert draw(runs).axes, name


def test_claims_can_fail(runs):
    """Measured on the wrong runs they do not come out: a climb is no no-motion line, upright is no
    flat pipe."""
    wrong = {"no_motion_line": runs["vertical_climb"], "rolled_past_180": runs["vertical_climb"]}
    upright = runs["rolling_upright"]
    same = {"rolling_upright": upright, "rolling_flat": upright}
    for claim, given in (
        (driving.no_motion_line, wrong),
        (driving.opposite_motion_past_180, wrong),
        (driving.eq8_unequal_arms, same),
    ):
        found = claim(given)
        assert found.verdict is ClaimVerdict.FAILS
        assert found.changed


def test_min_preload_is_the_friction_law():
    """m g / (3 mu)."""
    assert min_preload(Omnitrack(), 0.5) == pytest.approx(1.0 * 9.81 / 1.5)


def test_rate_counts_and_gives_its_interval(runs):
    """One of one."""
    passed, total, text = readings.rate(runs["vertical_climb"])
    assert (passed, total) == (1, 1)
    assert "1 of 1 (100.0 %, 95 % interval 20.7 to 100.0)" in text
    assert runs["vertical_climb"][0].outcome is Outcome.REACHED_GOAL


class _Links(html.parser.HTMLParser):
    """Collects ids and references of a page."""

    def __init__(self):
        super().__init__()
        self.sources, self.anchors, self.ids = [], [], []

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.sources += [v for k, v in named.items() if k == "src"]
        self.anchors += [v for k, v in named.items() if k == "href"]
        self.ids += [v for k, v in named.items() if k == "id"]


def test_page_needs_no_network_and_escapes_text():
    """Pictures are inside, links lead within the page, the paper's words are not markup."""
    figure = ReportFigure("x", "A caption", b"<svg/>", "svg+xml")
    stills = ReportFigure("y", "A run", b"not shown", "jpeg")
    text = page([FINDING], [figure, stills], {"seed": 7}, ["A remark."])
    links = _Links()
    links.feed(text)
    assert len(links.sources) == 2
    assert all(source.startswith("data:image/") for source in links.sources)
    assert [anchor.lstrip("#") for anchor in links.anchors] == links.ids == ["a_b"]
    assert "says &lt;b&gt; &amp;" in text
    assert "http" not in text.replace("http-equiv", "")


def test_a_foreign_folder_is_refused_before_anything_runs(tmp_path, monkeypatch):
    """A folder with other files in it is left alone."""
    (tmp_path / "thesis.tex").write_text("mine")
    monkeypatch.setattr(command, "run_all", lambda *_: pytest.fail("ran"))
    with pytest.raises(OutputError, match="choose another folder"):
        command.reproduce(tmp_path, quick=True)
    assert (tmp_path / "thesis.tex").read_text() == "mine"


def fails(runs):
    raise ValueError("no such colour")


def test_claims_name_figures_of_the_page():
    """Each figure that a claim says shows it is drawn, and each claim has a name of its own."""
    names = {name for claim in command.CLAIMS for name in claim.figures}
    assert names
    assert names <= set(command.FIGURES)
    assert len({claim.id for claim in command.CLAIMS}) == len(command.CLAIMS)


def test_limits_of_a_claim_decide_and_stand_in_its_statement(runs):
    """A climb that is 1 % off holds within 1 % and fails within a millionth of it."""
    claim = driving.vertical_climb
    strict = replace(claim, limits={"percent": 1e-6})
    assert "within 1 % straight up" in claim.text
    assert "within 1e-06 % straight up" in strict.text
    assert claim(runs).verdict is ClaimVerdict.HOLDS
    assert strict(runs).verdict is ClaimVerdict.FAILS


def test_pictures_that_fail_cost_no_claim(tmp_path, monkeypatch):
    """Claims, page and the other figures are there; the page says what is missing."""
    good = partial(plot_singularity, figure="sector")
    drawn = {"good": ("A sector.", lambda runs: good(TurnCase())), "bad": ("Nothing.", fails)}
    monkeypatch.setattr(command, "run_all", lambda *_: {})
    monkeypatch.setattr(command, "measure", lambda *_: [FINDING])
    monkeypatch.setattr(command, "_provenance", lambda *_: {"seed": 7})
    monkeypatch.setattr(command, "FIGURES", drawn)
    monkeypatch.setattr(command, "STRIPS", {"unknown": "Stills of no run."})
    no_stills = pytest.warns(PictureWarning, match="no stills unknown")
    with no_stills, pytest.warns(PictureWarning, match="no figure bad: no such colour"):
        assert command.reproduce(tmp_path / "paper", quick=True) == [FINDING]
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.*")}
    assert found == {"paper/claims.json", "paper/figures/good.svg", "paper/report.html"}
    text = (tmp_path / "paper" / "report.html").read_text()
    assert "could not be drawn: bad, unknown." in text


def _results(**changes):
    base = sample_result()
    key = next(iter(changes))
    path = {"friction": "world.friction", "theta5": "start.theta5_deg"}[key]
    return [
        sample_result(scenario=override(base.scenario, {path: value})) for value in changes[key]
    ]


def test_claims_say_what_they_were_made_with_and_by_how_much():
    """Versions and seed, and the runs of all groups; without any run, versions alone."""
    runs = {"a": [sample_result(duration_s=1.5)], "b": [sample_result(duration_s=2.25)] * 2}
    made = command._provenance(runs, quick=False)
    assert (made["runs"], made["simulated_s"], made["form"]) == (3, 6.0, "full")
    assert made["seed"] == command.SEED
    assert set(environment()) < set(made)
    assert "scenario_sha256" not in made
    assert command._provenance({}, quick=True) == {**environment(), "form": "quick"}


def test_trials_are_counted_by_friction():
    """A range holds its lower end and not its upper one."""
    groups = by_friction(_results(friction=[0.6, 0.62, 0.65, 0.9]))
    assert [(name, total) for name, _, total in groups] == [
        ("friction 0.60 to 0.65", 2),
        ("friction 0.65 to 0.70", 1),
        ("friction 0.90 to 0.95", 1),
    ]


def test_the_preferred_orientation_is_the_nearest_to_zero():
    """Of -60, 5 and 30 degrees 5 is nearest to 0."""
    assert preferred(_results(theta5=[-60.0, 5.0, 30.0])).scenario.start.theta5_deg == 5.0
